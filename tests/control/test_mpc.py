"""A plan follows from what the lift is shown, and a lift that cannot be planned with is refused."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from made_models import WITH_ALL, WITH_PAST, WITH_ROAD, make_bundle

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import Array, Bundle, Lift
from rt_controller.contract.errors import ArtifactError, ConfigError
from rt_controller.contract.follow import Follow
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.schema import VEHICLE
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.solver import SolveStatus

STATE = VehicleState(21.0, 0.1, 0.05, 0.52, -0.3, 0.02)
PATH = PathReference(0.0, 0.01, 0.0, 0.0, 20.0, 0.0)
PREVIOUS = ControlInput(0.2, 0.0, 0.05)
CURVATURE_PER_M = 0.003
SAME = 1e-4
"""of an input's range: as exact as the solver is asked to be"""
RANGE = np.array(INPUT_LIMITS.upper) - np.array(INPUT_LIMITS.lower)


def build(bundle: Bundle, latent_weight: float = 0.0) -> Mpc:
    settings = MpcSettings(latent_weight=latent_weight)
    return Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)


def plan(mpc: Mpc, curvature_per_m: float = CURVATURE_PER_M) -> Array:
    assert mpc.plan(STATE, curvature_per_m, PATH, PREVIOUS) is SolveStatus.SOLVED
    return mpc.inputs / RANGE


def test_a_bilinear_model_frozen_here_plans_as_the_linear_one_that_it_is() -> None:
    bundle = make_bundle(WITH_ROAD, rank=2)
    assert bundle.bilinear is not None
    bundle = replace(bundle, bilinear=bundle.bilinear._replace(follows=Follow.START))
    psi_0 = Encoder(bundle).lift(STATE, CURVATURE_PER_M)
    frozen = replace(bundle, B_uc=bundle.input_matrix(psi_0), bilinear=None)
    found = plan(build(bundle))
    np.testing.assert_allclose(found, plan(build(frozen)), rtol=0.0, atol=1e-3)
    constant = plan(build(replace(bundle, bilinear=None)))
    assert np.abs(found - constant).max() > 0.01


@pytest.mark.parametrize("lift", [Lift(), WITH_ROAD, WITH_PAST, WITH_ALL])
def test_the_same_situation_has_the_same_plan_again(lift: Lift) -> None:
    mpc = build(make_bundle(lift, rank=2))
    mpc.forget()
    first = plan(mpc)
    mpc.forget()
    mpc.plan(STATE._replace(vx_mps=15.0), 0.0, PATH, PREVIOUS)
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), first, rtol=0.0, atol=SAME)


def test_without_anything_observed_the_state_is_taken_to_have_lasted() -> None:
    bundle = make_bundle(WITH_PAST, rank=2, bend=1.0)
    told = build(bundle)
    for _ in range(WITH_PAST.history_steps + 1):
        told.observe(STATE, PREVIOUS)
    np.testing.assert_allclose(plan(build(bundle)), plan(told), rtol=0.0, atol=SAME)


def test_another_past_has_another_plan_until_it_is_forgotten() -> None:
    mpc = build(make_bundle(WITH_PAST, rank=2, bend=1.0))
    lasting = plan(mpc)
    mpc.forget()
    for speed_mps in (12.0, 15.0, 18.0):
        mpc.observe(STATE._replace(vx_mps=speed_mps), PREVIOUS._replace(steer_rad=-0.5))
    mpc.observe(STATE, PREVIOUS)
    assert np.abs(plan(mpc) - lasting).max() > 0.01
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), lasting, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("lift", [WITH_PAST, WITH_ALL])
def test_latents_that_see_the_past_have_no_reference_to_be_held_to(lift: Lift) -> None:
    with pytest.raises(ConfigError, match=r"expected --mpc.latent-weight 0, found 0.001"):
        build(make_bundle(lift), latent_weight=0.001)


def test_a_reference_is_lifted_on_the_road_that_the_car_is_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lifted: list[tuple[Array, float]] = []
    lift_batch: Callable[[Encoder, Array, float], Array] = Encoder.lift_batch

    def watched(encoder: Encoder, states: Array, curvature_per_m: float) -> Array:
        lifted.append((states.copy(), curvature_per_m))
        return lift_batch(encoder, states, curvature_per_m)

    mpc = build(make_bundle(WITH_ROAD), latent_weight=0.001)
    monkeypatch.setattr(Encoder, "lift_batch", watched)
    plan(mpc)
    ((states, curvature_per_m),) = lifted
    assert curvature_per_m == CURVATURE_PER_M
    horizon = ReferenceHorizon(mpc.inputs.shape[0])
    np.testing.assert_array_equal(states, horizon.expand(PATH, STATE, CURVATURE_PER_M))


def test_a_model_of_other_signals_is_refused_before_anything_else() -> None:
    schema = replace(VEHICLE, states=VEHICLE.states[::-1])
    with pytest.raises(ArtifactError, match="not a model of this car"):
        build(replace(make_bundle(Lift()), schema=schema, encoder_onnx=b""))


@pytest.mark.parametrize("rank", [0, 2])
def test_a_state_that_is_no_number_is_a_status_and_the_next_one_is_planned(rank: int) -> None:
    mpc = build(make_bundle(WITH_PAST, rank=rank))
    first = plan(mpc).copy()
    mpc.forget()
    broken = STATE._replace(vy_mps=float("nan"))
    with np.errstate(all="ignore"):
        assert mpc.plan(broken, 0.0, PATH, PREVIOUS) is SolveStatus.NUMERICS
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), first, rtol=0.0, atol=SAME)
