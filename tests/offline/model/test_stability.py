"""The penalties on growth under inputs, the corners they are computed at, and radii."""

import math
from itertools import product

import numpy as np
import pytest
import torch
from torch import Tensor

from offline.config import PRESETS
from offline.data.signals import VEHICLE_ROLES
from offline.model.network import MdkNet
from offline.model.observables import Signs, Sizes, sizes_of
from offline.model.stability import (
    DRAWN,
    all_corners,
    driven_excess,
    driven_radius,
    radius_excess,
    spectral_radius,
    stability_loss,
)
from rt_controller.contract.signals import VEHICLE

pytestmark = pytest.mark.usefixtures("double_precision")
SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
SMALL = {"hidden": (8,), "latents": 7, "history_steps": 2}
RANKS = {"bilinear_rank": 2, "drift_rank": 2}
WIDE = torch.tensor([[0.0, 0.0, -2.0, -1.5], [3.0, 2.5, 2.0, 1.5]])


def a_model(sizes: Sizes = SIZES, signal_range: Tensor | None = WIDE, **changes: object) -> MdkNet:
    torch.manual_seed(1)
    any_entries = {"symmetry": "none", **SMALL, **RANKS}
    config = PRESETS["recommended"].model_copy(update={**any_entries, **changes})
    return MdkNet(config, sizes, signal_range).eval()


def damped(model: MdkNet, by: float = 0.5) -> MdkNet:
    """The same with small eigenvalues; the integrators of the path stay."""
    with torch.no_grad():
        model.A_rows *= by
    return model


def lifted(model: MdkNet, count: int = 40) -> Tensor:
    torch.manual_seed(2)
    psi = torch.randn(count, model.n_observables)
    psi[:, -1] = 1.0
    return psi


@pytest.mark.parametrize("size", [0.1, 0.9, 1.0, 1.01, 1.3, 20.0, 1e30])
def test_the_radius_excess_is_close_to_the_excess_of_the_spectral_radius(size: float) -> None:
    """Powers of 1e30 would overflow, those of 0.1 vanish."""
    torch.manual_seed(3)
    J = torch.randn(6, 5, 5)
    J = size * J / torch.linalg.eigvals(J).abs().amax(dim=-1)[:, None, None]
    found = radius_excess(J)
    assert found.shape == (6,)
    torch.testing.assert_close(found, torch.full((6,), max(size - 1.0, 0.0)), rtol=0.02, atol=0.01)


@pytest.mark.parametrize("eigenvalue", [0.97, 1.0, 1.02])
def test_the_gradient_of_the_radius_excess_is_finite_where_eigenvalues_coincide(
    eigenvalue: float,
) -> None:
    """A Jordan block, whose eigenvalues have an unbounded derivative."""
    block = eigenvalue * torch.eye(3) + torch.diag(torch.ones(2), 1)
    J = block[None].clone().requires_grad_()
    radius_excess(J).sum().backward()
    assert J.grad is not None
    assert torch.isfinite(J.grad).all()
    assert J.grad.norm() < 1e5


def test_all_corners_of_a_box_are_enumerated() -> None:
    signals, slopes = all_corners(a_model())
    expected = set(product(*WIDE.t().tolist()))
    assert {tuple(row) for row in signals.tolist()} == expected
    assert len(signals) == 16
    assert torch.equal(slopes, torch.ones(16, 2 * 3 + 2))


@pytest.mark.parametrize("place", [0, 7, 10])
def test_growth_of_any_block_is_penalised(place: int) -> None:
    """A state of the motion, a latent of the motion, a latent of the path."""
    model = damped(a_model())
    with torch.no_grad():
        model.A_rows[place, place] = 1.2
    model.zero_grad()
    excess = driven_excess(model, lifted(model))
    assert excess.item() > 0.1
    excess.backward()
    assert model.A_rows.grad is not None
    assert model.A_rows.grad[place, place] > 0.0


def with_feedback_of_an_input(model: MdkNet, size: float) -> MdkNet:
    """Input 2 acts on v_y by a gain that is v_y: J[1, 1] = A[1, 1] + size * input."""
    with torch.no_grad():
        model.N_rows.zero_()
        model.S.zero_()
        model.N_rows[1, 2], model.S[2, 1] = size, 1.0
    return model


def test_growth_that_only_an_input_at_its_bound_causes_is_penalised() -> None:
    model = with_feedback_of_an_input(damped(a_model()), 0.4)
    assert driven_radius(model) == pytest.approx(0.5 + 0.4 * 2.0, abs=0.01)
    assert driven_excess(model, lifted(model)).item() > 0.05
    weaker = with_feedback_of_an_input(damped(a_model()), 0.1)
    assert driven_excess(weaker, lifted(weaker)).item() == 0.0


def test_in_training_half_of_the_gains_are_saturated_as_far_as_at_lifted_states() -> None:
    """And those of one point entirely. All points of this box are the same."""
    at_the_bound = a_model(signal_range=WIDE[1:].expand(2, -1).clone())
    model = with_feedback_of_an_input(damped(at_the_bound), 0.4).train()
    with torch.no_grad():
        small, large = (driven_excess(model, size * lifted(model)) for size in (1e-2, 1e3))
    assert small > 0.1
    unsaturated = DRAWN // 2 - 1
    share = unsaturated / (unsaturated + DRAWN // 2)
    torch.testing.assert_close(large, share * small, rtol=0.01, atol=0.0)


def test_in_training_one_point_is_entirely_saturated() -> None:
    """There the saturation of the drift takes its part from A: J[1, 1] = 0.5 + 0.9."""
    model = damped(a_model())
    last = model.N_rows.shape[1] - 1
    with torch.no_grad():
        model.N_rows.zero_()
        model.S.zero_()
        model.N_rows[1, last], model.S[last, 1] = -0.9, 1.0
    at_rest = torch.zeros(40, model.n_observables)
    with torch.no_grad():
        assert driven_excess(model, at_rest).item() == 0.0
        drawn = driven_excess(model.train(), at_rest)
    assert drawn.item() * DRAWN == pytest.approx(2.0 * 0.4, rel=0.1)


@pytest.mark.parametrize("is_training", [False, True])
def test_the_excess_does_not_depend_on_the_units_of_a_latent(is_training: bool) -> None:
    model, place = a_model().train(is_training), 7
    psi = lifted(model)
    with torch.no_grad():
        model.A_rows *= 1.05
        torch.manual_seed(5)
        before = driven_excess(model, psi)
        model.A_rows[place] *= 100.0
        model.A_rows[:, place] /= 100.0
        model.N_rows[place] *= 100.0
        model.S[:, place] /= 100.0
        psi[:, place] *= 100.0
        torch.manual_seed(5)
        after = driven_excess(model, psi)
    assert before > 0.0
    torch.testing.assert_close(after, before, rtol=1e-6 if is_training else 0.01, atol=0.0)


@pytest.mark.parametrize("stability", ["driven", "gelfand", "eigenvalue"])
def test_every_penalty_has_a_finite_gradient(stability: str) -> None:
    config = PRESETS["recommended"].model_copy(update={"stability": stability})
    model = a_model()
    with torch.no_grad():
        model.A_rows *= 1.1
    loss = stability_loss(model, model.operator().A, lifted(model), config)
    loss.backward()
    assert loss.item() > 0.0
    assert model.A_rows.grad is not None
    assert torch.isfinite(model.A_rows.grad).all()
    assert model.A_rows.grad.abs().max() > 0.0


TINY = Sizes(
    states=3,
    inputs=2,
    exogenous=1,
    remembered=0,
    dt_s=0.1,
    signs=Signs((1.0,) * 3, (1.0,) * 2, (1.0,), ()),
    is_symmetric=False,
)
TINY_LAYERS = {
    "hidden": (4,),
    "latents": 2,
    "history_steps": 0,
    "bilinear_rank": 1,
    "drift_rank": 1,
}


def a_tiny_model() -> MdkNet:
    torch.manual_seed(0)
    return MdkNet(PRESETS["recommended"].model_copy(update=TINY_LAYERS), TINY)


def test_the_spectral_radius_is_that_of_a() -> None:
    model = a_tiny_model()
    with torch.no_grad():
        model.A_rows[:, :4] = torch.diag(torch.tensor([0.5, -1.25, 0.9, 0.0]))
        model.A_rows[0, 2] = 7.0
    assert spectral_radius(model) == pytest.approx(1.25)


def test_the_driven_radius_is_the_largest_of_all_corners() -> None:
    model = a_tiny_model()
    with torch.no_grad():
        model.N_rows *= 50.0
    matrices = model.driven_matrices(*all_corners(model)).detach().double().numpy()
    expected = max(abs(np.linalg.eigvals(J)).max() for J in matrices)
    assert driven_radius(model) == pytest.approx(expected)
    assert driven_radius(model) > spectral_radius(model) + 0.01


def test_a_model_that_is_not_finite_has_no_radius() -> None:
    model = a_tiny_model()
    with torch.no_grad():
        model.A_rows[0, 0] = torch.nan
    assert math.isnan(spectral_radius(model))
    assert math.isnan(driven_radius(model))
