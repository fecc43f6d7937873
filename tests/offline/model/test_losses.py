"""The horizon loss and the roll-outs against transcriptions with loops, in float64."""

import math

import pytest
import torch
import transcribed_model
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from offline.config import PRESETS, STEPS, TrainingConfig
from offline.data.sampling import Batch, Instants
from offline.data.signals import VEHICLE_ROLES
from offline.model import losses
from offline.model.losses import (
    evaluate,
    horizon_of_step,
    log_error,
    state_errors,
    total_loss,
)
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.rollout import roll_out
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.follow import Follow

pytestmark = pytest.mark.usefixtures("double_precision")
K, BATCH, HISTORY, STATES = 7, 3, 2, 6
SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)


def a_config(**changes: object) -> TrainingConfig:
    small = {"hidden": (8, 8), "latents": 6, "history_steps": HISTORY, "bilinear_rank": 2}
    small |= {"drift_rank": 2}
    return PRESETS["recommended"].model_copy(update={"symmetry": "none", **small, **changes})


def a_model(config: TrainingConfig) -> MdkNet:
    torch.manual_seed(1)
    model = MdkNet(config, SIZES)
    with torch.no_grad():
        model.A_rows += 0.1 * torch.randn_like(model.A_rows)
        model.B_rows += 0.1 * torch.randn_like(model.B_rows)
        model.N_rows += 0.3 * torch.randn_like(model.N_rows)
        model.S += 0.3 * torch.randn_like(model.S)
    return model


def a_batch() -> Batch:
    torch.manual_seed(2)
    return Batch(
        torch.randn(K + 1, BATCH, STATES),
        torch.randn(K, BATCH, 3),
        torch.randn(K, BATCH, 1),
        torch.randn(HISTORY + K, BATCH, 6),
        torch.ones(1, BATCH, 1),
    )


def first_instant(batch: Batch, b: int) -> Instants:
    return Instants(batch.x[0, b], batch.w[0, b], batch.memory[:HISTORY, b])


def transcribed_errors(model: MdkNet, batch: Batch) -> list[Tensor]:
    """Mean squared error of each state, computed with loops."""
    sums = [torch.zeros(()) for _ in range(STATES)]
    for b in range(BATCH):
        psi0 = model.lift(first_instant(batch, b))
        predicted = transcribed_model.roll_out(model, psi0, batch.u[:, b], batch.w[:, b])
        for k in range(batch.steps):
            for i in range(STATES):
                sums[i] = sums[i] + (batch.x[k + 1, b, i] - predicted[k, i]) ** 2
    return [each / (batch.steps * BATCH) for each in sums]


def transcribed_loss(model: MdkNet, batch: Batch) -> Tensor:
    return sum(torch.log(error) for error in transcribed_errors(model, batch)) / STATES


def learned(model: MdkNet) -> list[Tensor]:
    """The parameters; without gains, theirs are empty."""
    return [parameter for parameter in model.parameters() if parameter.numel()]


def test_the_loss_is_finite_if_a_state_is_predicted_exactly():
    errors = torch.tensor([0.0, 1.0], requires_grad=True)
    loss = log_error(errors)
    loss.backward()
    assert torch.isfinite(loss)
    assert torch.all(torch.isfinite(errors.grad))


def test_single_step_loss_is_the_mean_squared_error_of_a_step_written_out():
    config = a_config(weight_single_step=1.0)
    model, batch, times = a_model(config), a_batch(), torch.arange(1, K + 1)
    before, after = model.lift(batch.at(times - 1)), model.lift(batch.at(times))
    errors = [
        psi - transcribed_model.step(model, start, start, batch.u[t - 1, b], batch.w[t - 1, b])
        for t, starts, ends in zip(times.tolist(), before, after, strict=True)
        for b, (start, psi) in enumerate(zip(starts, ends, strict=True))
    ]
    found = total_loss(model, config, batch).single_step
    assert torch.isclose(found, torch.stack(errors).square().sum(dim=1).mean())


seeded = settings(derandomize=True, deadline=None)
growths = st.floats(0.01, 1.0)
first_lengths = st.integers(1, STEPS)


@seeded
@given(st.integers(1, 400), growths, first_lengths)
def test_the_horizon_grows_monotonically_from_its_start_to_all_steps(steps, growth, start):
    config = a_config(horizon_start=start, horizon_growth=growth, steps=steps)
    lengths = [horizon_of_step(step, config, STEPS) for step in range(steps)]
    assert lengths == sorted(lengths)
    assert lengths[0] == start
    whole_from = math.ceil(max(growth * steps, 1.0))
    assert all(length == STEPS for length in lengths[whole_from:])


def test_the_horizon_grows_linearly():
    config = a_config(horizon_start=8, horizon_growth=0.3, steps=10_000)
    assert horizon_of_step(1500, config, 80) == 44
    assert horizon_of_step(0, a_config(horizon_start=None), STEPS) == STEPS


ROLLED, N, GAINS = 5, 4, 6
saturation = pytest.mark.parametrize("saturates", [False, True])


def arguments(gains: int = GAINS) -> tuple[Tensor, ...]:
    """psi0, A, forcing, S, N, and the factors, which have no gradient."""
    torch.manual_seed(1)
    shapes = ((BATCH, N), (N, N), (ROLLED, BATCH, N), (gains, N), (N, gains))
    made = [(0.6 * torch.randn(shape)).requires_grad_() for shape in shapes]
    return (*made, torch.randn(ROLLED, BATCH, gains))


@saturation
def test_the_gradient_equals_the_numerical_one(saturates: bool) -> None:
    *learned, factors = arguments()

    def rolled(psi0: Tensor, A: Tensor, forcing: Tensor, S: Tensor, columns: Tensor) -> Tensor:
        return roll_out(psi0, A, forcing, (S, columns, factors), saturates)

    assert torch.autograd.gradcheck(rolled, tuple(learned))


def test_without_gains_it_is_the_linear_roll_out_with_the_same_gradient() -> None:
    psi0, A, forcing, S, columns, factors = arguments(gains=0)
    without = roll_out(psi0, A, forcing, (S, columns, factors), saturates=True)
    linear = roll_out(psi0, A, forcing)
    assert torch.equal(without, linear)
    weights = torch.randn_like(linear)
    given = (psi0, A, forcing)
    ours = torch.autograd.grad((without * weights).sum(), given)
    theirs = torch.autograd.grad((linear * weights).sum(), given)
    assert all(torch.equal(one, other) for one, other in zip(ours, theirs, strict=True))


@pytest.mark.parametrize(
    "changes",
    [
        {"bilinear_rank": 0, "drift_rank": 0},
        {"saturating_gains": False, "separate_motion": False},
        *({"bilinear_follows": follows} for follows in Follow),
    ],
)
def test_the_horizon_loss_and_its_gradient_are_those_of_the_transcription(changes):
    config = a_config(**changes)
    ours, naive, batch = a_model(config), a_model(config), a_batch()
    found, expected = total_loss(ours, config, batch), transcribed_loss(naive, batch)
    assert torch.isclose(found.multi_step, expected)
    assert torch.isclose(found.states, torch.stack(transcribed_errors(naive, batch)).mean())
    found.multi_step.backward()
    expected.backward()
    for one, other in zip(ours.parameters(), naive.parameters(), strict=True):
        assert not one.numel() or torch.any(one.grad != 0.0)
        assert not one.numel() or torch.allclose(one.grad, other.grad, rtol=1e-8, atol=1e-12)


def test_a_trajectory_of_weight_two_counts_twice():
    config = a_config(weight_single_step=0.5)
    model, batch = a_model(config), a_batch()
    weighted = batch._replace(weight=torch.tensor([2.0, 1.0, 1.0])[None, :, None])
    alone = [Batch(*(series[:, [b]] for series in batch)) for b in (0, 0, 1, 2)]
    for of in (
        lambda part: state_errors(model, part),
        lambda part: total_loss(model, config, part).single_step,
    ):
        assert torch.allclose(of(weighted), torch.stack([of(b) for b in alone]).sum(dim=0) / BATCH)


@pytest.mark.parametrize("chunk", [1, 2, 10_000])
@pytest.mark.parametrize("preset", ["paper", "recommended"])
def test_the_validation_loss_is_that_of_all_trajectories_at_once(monkeypatch, preset, chunk):
    monkeypatch.setattr(losses, "CHUNK", chunk)
    small = {"hidden": (8, 8), "latents": 6, "history_steps": 0}
    config = PRESETS[preset].model_copy(update=small)
    torch.manual_seed(1)
    model, batch = MdkNet(config, SIZES), a_batch()._replace(memory=torch.zeros(K, BATCH, 6))
    with torch.no_grad():
        expected = total_loss(model.eval(), config, batch)
    found = evaluate(model, config, batch, torch.device("cpu"))
    assert found.multi_step == pytest.approx(expected.multi_step.item(), rel=1e-5)
    assert found.total == pytest.approx(expected.total.item(), rel=1e-5)
    assert found.states == pytest.approx(expected.states.item(), rel=1e-5)
