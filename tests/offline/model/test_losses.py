"""The horizon loss against a transcription with loops, in float64."""

import math

import pytest
import torch
import transcribed_model
from torch import Tensor

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import Batch, Instants
from offline.data.signals import VEHICLE_ROLES
from offline.model.losses import (
    log_error,
    single_step_loss,
    state_errors,
    total_loss,
)
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.follow import Follow

pytestmark = pytest.mark.usefixtures("double_precision")

K, BATCH, HISTORY, STATES = 7, 3, 2, 6
SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)


def a_config(**changes: object) -> TrainingConfig:
    small = {"hidden": (8, 8), "latents": 6, "history_steps": HISTORY, "bilinear_rank": 2}
    small |= {"path_latents": 2, "path_hidden": (6,), "path_rank": 1, "drift_rank": 2}
    return PRESETS["recommended"].model_copy(update={**small, **changes})


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


ALONG = [
    {"bilinear_rank": 0, "drift_rank": 0},
    {"bilinear_rank": 0},
    {"saturating_gains": False},
    {"separate_motion": False},
    *({"bilinear_rank": 2, "bilinear_follows": follows} for follows in Follow),
]


@pytest.mark.parametrize("changes", ALONG)
def test_the_horizon_loss_is_the_mean_log_of_the_mean_squared_errors(changes):
    config = a_config(**changes)
    model, batch = a_model(config), a_batch()
    found = total_loss(model, config, batch)
    assert found.multi_step.item() == pytest.approx(transcribed_loss(model, batch).item())
    expected = torch.stack(transcribed_errors(model, batch))
    assert torch.allclose(state_errors(model, batch), expected)
    assert found.states.item() == pytest.approx(expected.mean().item())


def test_a_trajectory_of_weight_two_counts_twice():
    model, batch = a_model(a_config()), a_batch()
    once = [state_errors(model, Batch(*(series[:, [b]] for series in batch))) for b in range(BATCH)]
    weight = torch.ones(1, BATCH, 1)
    weight[0, 0, 0] = 2.0
    expected = (torch.stack(once).sum(dim=0) + once[0]) / BATCH
    assert torch.allclose(state_errors(model, batch._replace(weight=weight)), expected)


def test_a_trajectory_of_weight_two_counts_twice_in_the_single_step_loss():
    config = a_config(weight_single_step=0.5)
    model, batch = a_model(config), a_batch()
    parts = (Batch(*(series[:, [b]] for series in batch)) for b in range(BATCH))
    once = [total_loss(model, config, part).single_step for part in parts]
    weight = torch.ones(1, BATCH, 1)
    weight[0, 0, 0] = 2.0
    found = total_loss(model, config, batch._replace(weight=weight)).single_step
    assert torch.isclose(found, (torch.stack(once).sum() + once[0]) / BATCH)


@pytest.mark.parametrize("changes", ALONG)
def test_the_gradient_equals_that_of_the_transcription(changes):
    config = a_config(**changes)
    ours, naive, batch = a_model(config), a_model(config), a_batch()
    total_loss(ours, config, batch).multi_step.backward()
    transcribed_loss(naive, batch).backward()
    for one, other in zip(learned(ours), learned(naive), strict=True):
        assert torch.any(one.grad != 0.0)
        assert torch.allclose(one.grad, other.grad, rtol=1e-8, atol=1e-12)


def learned(model: MdkNet) -> list[Tensor]:
    """The parameters; without gains, theirs are empty."""
    return [parameter for parameter in model.parameters() if parameter.numel()]


@pytest.mark.parametrize("stability", ["driven", "gelfand"])
def test_total_loss_is_the_weighted_sum_of_its_terms(stability):
    config = a_config(
        weight_single_step=0.7, weight_stability=1.6, stability=stability, decay_operator=0.5
    )
    model, batch = a_model(config), a_batch()
    with torch.no_grad():
        model.A_rows += 0.1
    losses = total_loss(model, config, batch, torch.tensor([2, 5]))
    terms = (losses.single_step, losses.multi_step, losses.stability, losses.regularisation)
    assert all(term != 0.0 for term in terms)
    weights = (0.7, 1.0, 1.6, 1e-4)
    expected = sum(weight * term for weight, term in zip(weights, terms, strict=True))
    assert torch.isclose(losses.total, expected)


@pytest.mark.parametrize("prior", ["zero", "identity"])
def test_regularisation_measures_the_operator_from_its_prior(prior):
    config = a_config(operator_prior=prior, decay_operator=0.5, decay_encoder=0.0)
    model = a_model(config)
    A, B = model.operator()
    towards = torch.eye(len(A)) if prior == "identity" else torch.zeros_like(A)
    expected = 0.5 * ((A - towards).square().sum() + B.square().sum())
    assert torch.isclose(total_loss(model, config, a_batch()).regularisation, expected)


def in_tenfold_units(model: MdkNet, batch: Batch, i: int) -> tuple[MdkNet, Batch]:
    """The same model and data with state i in a unit ten times smaller."""
    config = a_config(history_steps=0)
    other = a_model(config)
    x = batch.x.clone()
    x[..., i] *= 10.0
    with torch.no_grad():
        for one, source in zip(other.parameters(), model.parameters(), strict=True):
            one.copy_(source)
        for encoder in other.encoders:
            encoder.layers[0].weight[:, encoder.columns == i] /= 10.0
        other.A_rows[i] *= 10.0
        other.A_rows[:, i] /= 10.0
        other.B_rows[i] *= 10.0
        other.N_rows[i] *= 10.0
        other.S[:, i] /= 10.0
    return other, batch._replace(x=x)


@pytest.mark.parametrize("i", range(STATES))
def test_the_unit_of_a_state_adds_a_constant_and_changes_no_gradient(i):
    config = a_config(history_steps=0)
    model = a_model(config)
    batch = a_batch()._replace(memory=torch.zeros(K, BATCH, 6))
    other, rescaled = in_tenfold_units(model, batch, i)
    here, there = (
        total_loss(*arguments).multi_step
        for arguments in ((model, config, batch), (other, config, rescaled))
    )
    assert (there - here).item() == pytest.approx(math.log(100.0) / STATES)
    here.backward()
    there.backward()
    for one, another in zip(model.encoders, other.encoders, strict=True):
        last, other_last = one.layers[-1].weight.grad, another.layers[-1].weight.grad
        assert torch.any(last != 0.0)
        assert torch.allclose(last, other_last, rtol=1e-8, atol=1e-12)
    latents = slice(STATES, None)
    assert torch.allclose(model.B_rows.grad[latents], other.B_rows.grad[latents], atol=1e-12)


def test_a_tenth_less_error_counts_the_same_in_every_state():
    errors = torch.tensor([1e-4, 3.0, 200.0])
    gains = [log_error(errors) - log_error(errors * (1 - 0.1 * torch.eye(3)[i])) for i in range(3)]
    assert torch.stack(gains).tolist() == pytest.approx([-math.log(0.9) / 3] * 3)


def test_the_loss_is_finite_if_a_state_is_predicted_exactly():
    errors = torch.tensor([0.0, 1.0], requires_grad=True)
    loss = log_error(errors)
    loss.backward()
    assert torch.isfinite(loss)
    assert torch.all(torch.isfinite(errors.grad))


def test_only_the_first_instant_is_encoded():
    """Latents of later steps are not targets."""
    config = a_config()
    model, batch = a_model(config), a_batch()
    errors = state_errors(model, batch)
    memory = batch.memory.clone()
    memory[HISTORY:] += 1.0
    assert torch.equal(state_errors(model, batch._replace(memory=memory)), errors)
    memory[:HISTORY] += 1.0
    assert not torch.equal(state_errors(model, batch._replace(memory=memory)), errors)


def test_the_errors_of_a_shortened_batch_are_those_of_its_first_steps():
    config = a_config()
    model, batch = a_model(config), a_batch()
    late = batch._replace(x=batch.x.clone())
    late.x[5:] += 10.0
    short = state_errors(model, batch.shorten(4))
    assert torch.equal(state_errors(model, late.shorten(4)), short)
    assert torch.allclose(short, torch.stack(transcribed_errors(model, batch.shorten(4))))


def test_single_step_loss_uses_the_input_matrix_at_the_start_of_each_step():
    config = a_config(weight_single_step=1.0)
    model, batch = a_model(config), a_batch()
    times = torch.tensor([1, 4, K])
    A, _ = model.operator()
    before, after = model.lift(batch.at(times - 1)), model.lift(batch.at(times))
    forcing = torch.stack(
        [
            torch.cat(
                [
                    model.forcing(
                        before[j, b][None, None],
                        batch.u[t - 1, b][None, None],
                        batch.w[t - 1, b][None, None],
                    )[0]
                    for b in range(BATCH)
                ]
            )
            for j, t in enumerate(times.tolist())
        ]
    )
    found = total_loss(model, config, batch, times).single_step
    assert torch.isclose(found, single_step_loss(before, after, A, forcing))


def test_single_step_loss_is_not_computed_without_weight():
    config = a_config(weight_single_step=0.0)
    losses = total_loss(a_model(config), config, a_batch(), torch.tensor([1, 4]))
    assert losses.single_step == 0.0


def test_single_step_loss_uses_all_targets_without_sampling():
    """Without `target_samples` all targets are encoded."""
    config = a_config(weight_single_step=1.0, target_samples=None)
    model, batch = a_model(config), a_batch()
    every = torch.arange(1, K + 1)
    expected = total_loss(model, config, batch, every).single_step
    assert torch.isclose(total_loss(model, config, batch).single_step, expected)
