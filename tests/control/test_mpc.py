"""A plan depends on state, curvature and history."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from made_models import WITH_PAST, WITH_ROAD, input_matrix, make_bundle, one_step

from rt_controller.config import MpcSettings
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import (
    VEHICLE,
    ControlInput,
    CurvaturePreview,
    InputColumn,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.lift import Lift

STATE = VehicleState(21.0, 0.1, 0.05, 0.52, -0.3, 0.02)
PATH = PathReference(0.0, 0.01, 0.0, 0.0, 20.0, 0.0)
LIMIT_RAD = INPUT_LIMITS.upper.steer_rad
PREVIOUS = ControlInput(0.2, 0.0, 0.05)
CURVATURE_PER_M = 0.003
SAME = 1e-4
"""of an input's range: the tolerance of the solver"""
RANGE = np.array(INPUT_LIMITS.upper) - np.array(INPUT_LIMITS.lower)


def build(bundle):
    settings = MpcSettings()
    return Mpc(bundle, settings.horizon, settings.cost(), knots=settings.knots)


def plan(mpc, curvature_per_m=CURVATURE_PER_M):
    x_0 = mpc.observer.observe(STATE, PREVIOUS)
    assert mpc.plan(x_0, curvature_per_m, PATH, PREVIOUS) is SolveStatus.SOLVED
    return mpc.inputs / RANGE


def test_the_wheel_turns_at_most_at_a_rate_that_is_limited():
    mpc = build(make_bundle(WITH_ROAD, rank=2))
    usual = plan(mpc).copy()
    mpc.limit_steering(LIMIT_RAD, 0.1)
    mpc.forget()
    plan(mpc)
    angles_rad = [PREVIOUS.steer_rad, *mpc.inputs[:, InputColumn.steer_rad]]
    assert np.abs(np.diff(angles_rad)).max() <= 0.1 * PERIOD_S + 1e-6
    mpc.limit_steering(LIMIT_RAD, inf)
    mpc.forget()
    found = plan(mpc)
    np.testing.assert_allclose(found, usual, rtol=0.0, atol=SAME)
    assert np.abs(np.diff(found[:, InputColumn.steer_rad] * RANGE[2])).max() > 0.1 * PERIOD_S


def test_without_a_history_the_state_is_assumed_to_have_been_constant():
    bundle = make_bundle(WITH_PAST, rank=2, bend=1.0)
    observed = build(bundle)
    for _ in range(WITH_PAST.history_steps):
        observed.observer.observe(STATE, PREVIOUS)
    np.testing.assert_allclose(plan(build(bundle)), plan(observed), rtol=0.0, atol=SAME)


def test_another_history_has_another_plan_until_it_is_forgotten():
    mpc = build(make_bundle(WITH_PAST, rank=2, bend=1.0))
    constant = plan(mpc)
    mpc.forget()
    for speed_mps in (12.0, 15.0, 18.0):
        mpc.observer.observe(STATE._replace(vx_mps=speed_mps), PREVIOUS._replace(steer_rad=-0.5))
    assert np.abs(plan(mpc) - constant).max() > 0.01
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), constant, rtol=0.0, atol=SAME)


def test_a_model_of_other_signals_is_refused_before_its_encoder_is_opened():
    schema = replace(VEHICLE, states=VEHICLE.states[::-1])
    with pytest.raises(ArtifactError, match="cannot drive this car"):
        build(replace(make_bundle(Lift()), schema=schema, encoder_onnx=b""))


@pytest.mark.parametrize("rank", [0, 2])
def test_a_nan_state_is_a_status_and_the_next_state_is_planned(rank):
    mpc = build(make_bundle(WITH_PAST, rank=rank))
    first = plan(mpc).copy()
    mpc.forget()
    broken = STATE._replace(vy_mps=float("nan"))
    with np.errstate(all="ignore"):
        x_0 = mpc.observer.observe(broken, PREVIOUS)
        assert mpc.plan(x_0, 0.0, PATH, PREVIOUS) is SolveStatus.NUMERICS
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), first, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("rank", [0, 2])
def test_predicted_states_are_the_model_rolled_out_under_the_plan(rank):
    bundle = make_bundle(WITH_ROAD, rank=rank)
    mpc = build(bundle)
    assert mpc.predicted_states() is None
    plan(mpc)
    states = mpc.predicted_states()
    assert states is not None
    psi = Encoder(bundle).lift(STATE, CURVATURE_PER_M)
    expected = [psi[:6]]
    for u in mpc.inputs:
        driven = bundle.A @ psi + input_matrix(bundle, psi) @ u
        psi = driven + bundle.B_uw[:, 0] * CURVATURE_PER_M + bundle.c
        expected.append(psi[:6])
    np.testing.assert_allclose(states, expected, rtol=1e-9, atol=1e-9)
    mpc.prepare()
    assert mpc.predicted_states() is None


def test_the_plan_along_a_previewed_road_is_predicted_to_follow_the_road():
    state, path = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0), PATH._replace(c1=0.0)
    mpc = Mpc(load_bundle(shipped_model("mdk-net")), 20, MpcSettings().cost())
    errors = []
    for preview in (None, CurvaturePreview(3.0, 0.0, 0.002, 0.004, 0.006, 0.008)):
        mpc.forget()
        mpc.plan(state, 0.0, path, ControlInput(0.1, 0.0, 0.0), preview)
        states = mpc.predicted_states()
        errors.append(states[-1, 4])
    assert abs(errors[1] - errors[0]) < 0.05  # against 0.14 m if the car drove straight on


def test_a_plan_begins_after_the_inputs_that_are_under_way():
    """Of a linear model: as the plan of the state that is predicted after them."""
    bundle, straight = make_bundle(Lift(), latents=0), PATH._replace(c1=0.0, v_mps=21.0)
    under_way = (ControlInput(0.2, 0.0, 0.3), ControlInput(0.25, 0.0, 0.5))
    delayed, later = build(bundle), build(bundle)
    assert delayed.plan(STATE, 0.0, straight, PREVIOUS, None, under_way) is SolveStatus.SOLVED
    x = np.array([STATE])
    for u in under_way:
        x = one_step(bundle, x, np.array([u]), np.zeros((1, 1)))
    state = VehicleState(*x[0].tolist())
    assert later.plan(state, 0.0, straight, PREVIOUS) is SolveStatus.SOLVED
    found, expected = delayed.inputs / RANGE, later.inputs / RANGE
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=SAME)
    assert later.plan(STATE, 0.0, straight, PREVIOUS) is SolveStatus.SOLVED
    assert np.abs(later.inputs / RANGE - expected).max() > 100 * SAME
