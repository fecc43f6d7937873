"""A plan depends on state, curvature and history, and is explained by its QP."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from made_models import WITH_ALL, WITH_PAST, WITH_ROAD, input_matrix, make_bundle, one_step

from rt_controller.config import MpcSettings
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import (
    N_STATES,
    VEHICLE,
    ControlInput,
    CurvaturePreview,
    InputColumn,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.explanation import cost_shares
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.control.terms import Corridor
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import roll_out
from rt_controller.model.follow import Follow
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
    assert mpc.plan(STATE, curvature_per_m, PATH, PREVIOUS) is SolveStatus.SOLVED
    return mpc.inputs / RANGE


def test_a_frozen_bilinear_model_has_the_plan_of_its_linear_model():
    bundle = make_bundle(WITH_ROAD, rank=2)
    bundle = replace(bundle, gains=bundle.gains._replace(follows=Follow.START))
    psi_0 = Encoder(bundle).lift(STATE, CURVATURE_PER_M)
    frozen = replace(bundle, B_uc=input_matrix(bundle, psi_0), gains=None)
    found = plan(build(bundle))
    np.testing.assert_allclose(found, plan(build(frozen)), rtol=0.0, atol=1e-3)
    assert np.abs(found - plan(build(replace(bundle, gains=None)))).max() > 0.01


@pytest.mark.parametrize("lift", [Lift(), WITH_ROAD, WITH_PAST, WITH_ALL])
def test_the_same_parameters_have_the_same_plan_again(lift):
    mpc = build(make_bundle(lift, rank=2))
    mpc.forget()
    first = plan(mpc)
    mpc.forget()
    mpc.plan(STATE._replace(vx_mps=15.0), 0.0, PATH, PREVIOUS)
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), first, rtol=0.0, atol=SAME)


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
    for _ in range(WITH_PAST.history_steps + 1):
        observed.observe(STATE, PREVIOUS)
    np.testing.assert_allclose(plan(build(bundle)), plan(observed), rtol=0.0, atol=SAME)


def test_another_history_has_another_plan_until_it_is_forgotten():
    mpc = build(make_bundle(WITH_PAST, rank=2, bend=1.0))
    constant = plan(mpc)
    mpc.forget()
    for speed_mps in (12.0, 15.0, 18.0):
        mpc.observe(STATE._replace(vx_mps=speed_mps), PREVIOUS._replace(steer_rad=-0.5))
    mpc.observe(STATE, PREVIOUS)
    assert np.abs(plan(mpc) - constant).max() > 0.01
    mpc.forget()
    np.testing.assert_allclose(plan(mpc), constant, rtol=0.0, atol=SAME)


def test_a_model_of_other_signals_is_refused_before_its_encoder_is_opened():
    schema = replace(VEHICLE, states=VEHICLE.states[::-1])
    with pytest.raises(ArtifactError, match="not a model of this car"):
        build(replace(make_bundle(Lift()), schema=schema, encoder_onnx=b""))


@pytest.mark.parametrize("rank", [0, 2])
def test_a_nan_state_is_a_status_and_the_next_state_is_planned(rank):
    mpc = build(make_bundle(WITH_PAST, rank=rank))
    first = plan(mpc).copy()
    mpc.forget()
    broken = STATE._replace(vy_mps=float("nan"))
    with np.errstate(all="ignore"):
        assert mpc.plan(broken, 0.0, PATH, PREVIOUS) is SolveStatus.NUMERICS
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


BESIDE = VehicleState(21.0, 0.1, 0.05, 0.52, -0.6, 0.02)
SLOWER = PathReference(0.0, 0.01, 0.0, 0.0, 20.5, 0.0)
DEFAULT = MpcSettings()


def planned(corridor=None, settings=DEFAULT):
    bundle, knots = load_bundle(shipped_model("lti")), settings.knots
    mpc = Mpc(bundle, settings.horizon, settings.cost(), corridor, knots=knots)
    assert mpc.plan(BESIDE, 0.001, SLOWER, PREVIOUS) is SolveStatus.SOLVED
    return mpc


@pytest.mark.parametrize("heading", ["course", "epsi"])
@pytest.mark.parametrize("corridor", [None, Corridor(0.3, 0.05)])
def test_the_cost_shares_add_up_to_the_objective_of_the_qp(corridor, heading):
    """Of a linear model: the objective is the sum without what does not depend on the inputs."""
    settings = MpcSettings(heading=heading)
    mpc = planned(corridor, settings)
    costs = mpc.explain_plan().costs
    program, parameters, bundle = mpc._qp.program, mpc._qp.parameters, mpc._bundle
    nothing, knots = np.zeros_like(mpc.inputs), mpc._qp.knots
    W = np.full((1, len(nothing), 1), 0.001)
    (free,) = roll_out(bundle, parameters.psi[None], nothing[None], W, N_STATES)
    without = cost_shares(
        settings.cost(),
        None,
        free[[0, *knots.ends]],
        parameters,
        nothing,
        mpc._qp.objective.length_m,
        knots.intervals,
    )
    z = mpc._solver.solution
    objective = 0.5 * z @ program.P @ z + program.q @ z
    difference = sum(each.cost for each in costs) - sum(each.cost for each in without)
    assert difference == pytest.approx(objective, rel=1e-6)
    assert sum(each.share for each in costs) == pytest.approx(1.0)
    assert ("beyond the corridor" in {each.term for each in costs}) is (corridor is not None)


def test_the_second_solution_is_the_first_one():
    mpc = planned()
    second = mpc.explain_plan().second
    assert second.status is SolveStatus.SOLVED
    assert second.largest_difference < 1e-4
    assert second.optimality_residual < 1e-7 * np.abs(mpc._qp.program.q).max()


def test_active_bounds_are_named_with_signal_stage_and_side():
    mpc = planned()
    active, mpc_stages = mpc.explain_plan().active, mpc._qp.knots.stages
    first = {(each.kind, each.signal, each.side) for each in active if each.stage == 0}
    assert ("change", "steer_rad", "upper") in first
    assert ("value", "brake_n", "both") in first
    assert {each.stage for each in active} <= set(mpc_stages)
    for each in active:
        assert {"upper": 1.0, "lower": -1.0, "both": 0.0}[each.side] * each.multiplier >= -1e-8


def test_a_plan_that_failed_is_explained_by_the_second_solve():
    mpc = planned()
    nowhere = BESIDE._replace(ey_m=float("nan"))
    assert mpc.plan(nowhere, 0.001, SLOWER, PREVIOUS) is not SolveStatus.SOLVED
    found = mpc.explain_plan()
    assert found.second.status is not SolveStatus.SOLVED
    assert np.isnan(found.inputs).all()
    assert found.costs == ()
