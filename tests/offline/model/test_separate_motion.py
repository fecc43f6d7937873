"""The motion does not depend on the road; e_psi and e_y integrate exactly."""

import pytest
import torch
from torch import Tensor

from offline.config import PRESETS
from offline.data.sampling import Instants
from offline.data.signals import VEHICLE_ROLES
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.follow import Follow

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
MOTION, PATH = [0, 1, 2], [3, 4, 5]
DS, EY, EPSI = PATH
STEPS, BATCH, HISTORY = 12, 4, 3
LINEAR = {"bilinear_rank": 0, "path_rank": 0, "drift_rank": 0}
variants = pytest.mark.parametrize(
    "changes",
    [
        {},
        LINEAR,
        {"saturating_gains": False},
        {"constant_observable": False},
        {"lift_exogenous": False},
        *({"bilinear_follows": follows} for follows in Follow),
    ],
)


def a_model(**changes: object) -> MdkNet:
    """Every parameter differs from its initial value."""
    torch.manual_seed(1)
    small = {"hidden": (8,), "latents": 9, "path_latents": 3, "path_hidden": (6,)}
    ranks = {"history_steps": HISTORY, "bilinear_rank": 2, "path_rank": 2, "drift_rank": 2}
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


@variants
@pytest.mark.parametrize("column", PATH)
def test_the_motion_does_not_depend_on_a_path_state(changes, column):
    model, (now, u, w) = a_model(**changes), drive()
    here, there = predicted(model, now, u, w), predicted(model, elsewhere(now, column), u, w)
    torch.testing.assert_close(there[..., MOTION], here[..., MOTION], rtol=1e-6, atol=1e-6)
    assert not torch.allclose(there[..., PATH], here[..., PATH], atol=1e-3)


@variants
def test_the_motion_does_not_depend_on_curvature(changes):
    model, (now, u, w) = a_model(**changes), drive()
    on_another_road = now._replace(w=now.w + 5.0)
    here, there = predicted(model, now, u, w), predicted(model, on_another_road, u, w + 5.0)
    torch.testing.assert_close(there[..., MOTION], here[..., MOTION], rtol=1e-6, atol=1e-6)
    assert not torch.allclose(there[..., PATH], here[..., PATH], atol=1e-2)


def test_without_separate_motion_it_depends_on_both():
    model, (now, u, w) = a_model(separate_motion=False), drive()
    here = predicted(model, now, u, w)
    for other in (predicted(model, elsewhere(now, EY), u, w), predicted(model, now, u, w + 5.0)):
        assert not torch.allclose(other[..., MOTION], here[..., MOTION], atol=1e-3)


@variants
def test_the_motion_depends_on_motion_inputs_and_history(changes):
    model, (now, u, w) = a_model(**changes), drive()
    here = predicted(model, now, u, w)
    faster = now._replace(x=now.x + torch.eye(6)[0])
    earlier = now._replace(past=now.past + 1.0)
    for other in (
        predicted(model, faster, u, w),
        predicted(model, earlier, u, w),
        predicted(model, now, u + 1.0, w),
    ):
        assert not torch.allclose(other[..., MOTION], here[..., MOTION], atol=1e-3)


@variants
def test_a_lateral_offset_stays_in_e_y_and_changes_nothing_else_of_a_lifted_state(changes):
    """Of the lifted state: the latents of the path may depend on e_y."""
    model, (now, u, w) = a_model(**changes), drive()
    model.double()
    now, u, w = Instants(*(part.double() for part in now)), u.double(), w.double()
    with torch.no_grad():
        psi0 = model.lift(now)
        moved = psi0.clone()
        moved[:, EY] += 3.0
        difference = model.roll_out(moved, u, w) - model.roll_out(psi0, u, w)
    expected = torch.zeros_like(difference)
    expected[..., EY] = 3.0
    torch.testing.assert_close(difference, expected, rtol=0.0, atol=1e-12)


@variants
def test_a_heading_offset_stays_and_is_integrated_by_e_y_alone(changes):
    model, (now, u, w) = a_model(**changes), drive()
    model.double()
    now, u, w = Instants(*(part.double() for part in now)), u.double(), w.double()
    with torch.no_grad():
        psi0 = model.lift(now)
        turned = psi0.clone()
        turned[:, EPSI] += 0.5
        difference = model.roll_out(turned, u, w) - model.roll_out(psi0, u, w)
    slope = model.operator().A[EY, EPSI].item()
    expected = torch.zeros_like(difference)
    expected[..., EPSI] = 0.5
    expected[..., EY] = 0.5 * slope * torch.arange(1, STEPS + 1).double()[:, None]
    torch.testing.assert_close(difference, expected, rtol=1e-9, atol=1e-12)


@variants
def test_the_eigenvalues_of_the_integrators_are_exactly_one(changes):
    """In their block of A, which is triangular; and nothing else depends on e_y."""
    A = a_model(**changes).operator().A
    assert torch.equal(A[[EY, EPSI]][:, [EY, EPSI]].diagonal(), torch.ones(2))
    assert A[EPSI, EY] == 0.0
    others = [i for i in range(len(A)) if i != EY]
    assert torch.equal(A[others, EY], torch.zeros(len(others)))
    others.remove(EPSI)
    assert torch.equal(A[others, EPSI], torch.zeros(len(others)))


def test_training_changes_only_what_is_learned():
    """Entries that are zero or one by construction have no gradient."""
    model, (now, u, w) = a_model(), drive()
    model.roll_out(model.lift(now), u, w).square().sum().backward()
    rows = len(model.A_rows)
    for parameter, learned in (
        (model.A_rows, model.A_learned),
        (model.B_rows, model.B_learned),
        (model.N_rows, model.N_learned),
        (model.S, model.S_learned),
    ):
        assert parameter.grad is not None
        assert torch.equal(parameter.grad[learned == 0.0], torch.zeros(int((learned == 0).sum())))
        assert (learned == 0.0).any()
    assert model.A_rows.grad[:rows, 0].abs().min() > 0.0
