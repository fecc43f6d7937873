"""What the lift sees, which observables depend on which, and the effect of inputs."""

from math import exp

import pytest
import torch
import transcribed_model
from torch import Tensor

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import Instants
from offline.data.signals import VEHICLE_ROLES, Roles, mirror_signs, past_names
from offline.model.network import FADING_S, MdkNet
from offline.model.observables import Sizes, sizes_of
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from rt_controller.model.follow import Follow

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
STATES, LATENTS, HISTORY, RANK, BATCH = 6, 7, 3, 2, 4


def a_config(**changes: object) -> TrainingConfig:
    """All extensions switched on; `changes` switch some off."""
    small = {"hidden": (8, 8), "latents": LATENTS, "history_steps": HISTORY, "bilinear_rank": RANK}
    small |= {"drift_rank": 2}
    return PRESETS["recommended"].model_copy(update={**small, **changes})


def a_model(sizes: Sizes = SIZES, **changes: object) -> MdkNet:
    torch.manual_seed(1)
    model = MdkNet(a_config(**changes), sizes)
    with torch.no_grad():
        model.B_rows.normal_()
        model.N_rows.normal_()
        model.S.normal_()
    return model


@pytest.mark.parametrize("follows", Follow)
@pytest.mark.parametrize(
    "changes",
    [
        {"bilinear_rank": 0, "drift_rank": 0},
        {"bilinear_rank": 0},
        {"bilinear_rank": 1, "saturating_gains": False},
        {"bilinear_rank": 3, "drift_rank": 0},
        {"bilinear_rank": 3},
        {"bilinear_rank": 2, "constant_observable": False},
        {"separate_motion": False},
    ],
)
def test_a_roll_out_equals_the_recursion_written_out(changes, follows):
    model = a_model(bilinear_follows=follows, **changes)
    assert_written_out(model)


ROAD, WIND = VEHICLE.exogenous[0], Signal("wind_mps", "m/s")
INPUTS = (Signal("steer_rad", "rad"), Signal("force_n", "N"))
ROLES = Roles(centred=(), odd=None, past=("steer_rad",))


@pytest.mark.parametrize(
    ("schema", "has_path"),
    [
        (Schema(VEHICLE.states, INPUTS, (ROAD, WIND), 0.02), True),
        (Schema(VEHICLE.states, INPUTS, (WIND, ROAD), 0.025), False),
        (Schema(VEHICLE.states, INPUTS, (), 0.025), False),
        (Schema(VEHICLE.states[::-1], INPUTS, (ROAD,), 0.025), False),
        (Schema(VEHICLE.states[:3], INPUTS, (ROAD,), 0.1), False),
    ],
    ids=["road, then wind", "wind first", "no road", "other order", "no path"],
)
def test_a_roll_out_of_other_signals_equals_the_recursion_written_out(schema, has_path):
    model = a_model(sizes_of(schema, ROLES))
    assert (model.path is not None) == has_path
    assert_written_out(model)


def assert_written_out(model: MdkNet) -> None:
    with torch.no_grad():
        model.A_rows += 0.1 * torch.randn_like(model.A_rows)
    model.double()  # rounding errors would grow in these roll-outs
    psi0 = torch.randn(BATCH, model.n_observables).double()
    u = torch.randn(6, BATCH, model.sizes.inputs).double()
    w = torch.randn(6, BATCH, model.sizes.exogenous).double()
    with torch.no_grad():
        found = model.roll_out(psi0, u, w)
        for b in range(BATCH):
            expected = transcribed_model.roll_out(model, psi0[b], u[:, b], w[:, b])
            torch.testing.assert_close(found[:, b], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("changes", [{}, {"saturating_gains": False}, {"separate_motion": False}])
def test_the_driven_matrix_is_the_derivative_of_a_step(changes):
    model = a_model(**changes).double()
    psi = 0.3 * torch.randn(model.n_observables, dtype=torch.float64)
    u, w = torch.randn(3, dtype=torch.float64), torch.randn(1, dtype=torch.float64)

    def after(psi: Tensor) -> Tensor:
        return transcribed_model.step(model, psi, psi, u, w)

    slopes = 1.0 - torch.tanh(model.gains().S @ psi).square()
    J = model.driven_matrices(torch.cat([u, w])[None], slopes[None])[0]
    torch.testing.assert_close(J, torch.autograd.functional.jacobian(after, psi))


def test_fading_latents_start_with_the_configured_time_constants():
    model = a_model(latents=21)
    A = model.operator().A.detach()
    latents = A.diagonal()[STATES : STATES + 20]
    assert latents[0].item() == pytest.approx(exp(-0.025 / FADING_S[0]), abs=0.01)
    assert latents[-1].item() == pytest.approx(exp(-0.025 / FADING_S[1]), abs=0.01)
    assert torch.all(latents.diff() > -0.01)
    assert torch.allclose(A.diagonal()[:3], torch.ones(3), atol=0.01)
    assert A[-1].tolist() == [0.0] * 26 + [1.0]


@pytest.mark.parametrize("name", PRESETS)
def test_the_first_roll_out_of_every_preset_is_bounded(name):
    """A start with spectral radius 8 would reach 1e72 over the horizon."""
    config = PRESETS[name]
    torch.manual_seed(config.seed)
    model = MdkNet(config, SIZES)
    torch.manual_seed(3)
    now = Instants(
        torch.randn(32, STATES), torch.randn(32, 1), torch.randn(32, config.history_steps, 6)
    )
    with torch.no_grad():
        psi0 = model.lift(now)
        psi = model.roll_out(psi0, torch.randn(80, 32, 3), torch.randn(80, 32, 1))
    assert psi.abs().max() < 100.0


MOTION, PATH_STATES, EY, EPSI = [0, 1, 2], [3, 4, 5], 4, 5
STEPS = 12
LINEAR = {"bilinear_rank": 0, "drift_rank": 0}


def a_car_on_a_road(**changes: object) -> MdkNet:
    """Every parameter differs from its initial value."""
    torch.manual_seed(1)
    small = {"hidden": (8,), "latents": 9}
    ranks = {"history_steps": HISTORY, "bilinear_rank": 2, "drift_rank": 2}
    config = PRESETS["recommended"].model_copy(update={**small, **ranks, **changes})
    model = MdkNet(config, SIZES)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return model


def drive() -> tuple[Instants, Tensor, Tensor]:
    torch.manual_seed(2)
    now = Instants(torch.randn(BATCH, 6), torch.randn(BATCH, 1), torch.randn(BATCH, HISTORY, 6))
    return now, torch.randn(STEPS, BATCH, 3), torch.randn(STEPS, BATCH, 1)


def predicted(model: MdkNet, now: Instants, u: Tensor, w: Tensor) -> Tensor:
    with torch.no_grad():
        return model.roll_out(model.lift(now), u, w)[..., :6]


def elsewhere(now: Instants, column: int) -> Instants:
    """The same instant with another path state."""
    x = now.x.clone()
    x[:, column] += 10.0 * torch.randn(BATCH)
    return now._replace(x=x)


def test_training_changes_only_what_is_learned():
    """Entries that are zero by construction have no gradient."""
    model, (now, u, w) = a_car_on_a_road(), drive()
    model.roll_out(model.lift(now), u, w).square().sum().backward()
    for parameter, learned in (
        (model.A_rows, model.A_learned),
        (model.B_rows, model.B_learned),
        (model.N_rows, model.N_learned),
        (model.S, model.S_learned),
    ):
        assert parameter.grad is not None
        assert torch.equal(parameter.grad[learned == 0.0], torch.zeros(int((learned == 0).sum())))
        assert (learned == 0.0).any()
    assert model.A_rows.grad[model.A_learned[:, 0] == 1.0, 0].abs().min() > 0.0


@pytest.mark.parametrize(
    "changes", [{}, {"saturating_gains": False}, {"separate_motion": False}, {"products": False}]
)
@pytest.mark.parametrize("symmetry", ["exact", "trained"])
def test_a_symmetric_model_predicts_the_mirror_image_of_a_mirrored_drive(changes, symmetry):
    model, (now, u, w) = a_car_on_a_road(**changes, symmetry=symmetry), drive()
    names = (VEHICLE.state_names, VEHICLE.input_names, VEHICLE.exogenous_names)
    x, of_u, of_w, past = (
        torch.from_numpy(mirror_signs(each, VEHICLE_ROLES)).float()
        for each in (*names, past_names(VEHICLE, VEHICLE_ROLES))
    )
    mirrored = Instants(now.x * x, now.w * of_w, now.past * past)
    found = x * predicted(model, mirrored, u * of_u, w * of_w)
    difference = (found - predicted(model, now, u, w)).abs().max()
    assert (difference < 1e-5) == (symmetry == "exact")


def seen_on_the_road(model: MdkNet, now: Instants, u: Tensor, w: Tensor) -> tuple[bool, bool]:
    """Whether motion and path depend on a path state, or on curvature."""
    here = predicted(model, now, u, w)
    others = [predicted(model, elsewhere(now, column), u, w) for column in (EY, EPSI)]
    others.append(predicted(model, now._replace(w=now.w + 5.0), u, w + 5.0))
    differ = [(other - here).abs().amax(dim=(0, 1)) for other in others]
    return (
        any(bool((each[MOTION] > 1e-4).any()) for each in differ),
        all(bool((each[PATH_STATES] > 1e-3).any()) for each in differ),
    )


variants = pytest.mark.parametrize(
    "changes",
    [
        {},
        LINEAR,
        {"saturating_gains": False, "bilinear_follows": Follow.START},
        {"constant_observable": False, "lift_exogenous": False},
    ],
)


@variants
def test_the_motion_depends_on_motion_inputs_and_history_and_not_on_the_road(changes):
    model, (now, u, w) = a_car_on_a_road(**changes), drive()
    assert seen_on_the_road(model, now, u, w) == (False, True)
    here = predicted(model, now, u, w)
    faster = now._replace(x=now.x + torch.eye(6)[0])
    earlier = now._replace(past=now.past + 1.0)
    for other in (
        predicted(model, faster, u, w),
        predicted(model, earlier, u, w),
        predicted(model, now, u + 1.0, w),
    ):
        assert not torch.allclose(other[..., MOTION], here[..., MOTION], atol=1e-3)
    together = a_car_on_a_road(separate_motion=False)
    assert seen_on_the_road(together, now, u, w) == (True, True)
