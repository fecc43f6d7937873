"""The nonlinear programs model a vehicle, and both formulations have the same solution."""

import inspect

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the extra [peers] is not installed")

import casadi as ca

from benchmarks.peers.nonlinear.closed_loop_comparison import Nmpc
from benchmarks.peers.nonlinear.formulations import (
    Condensed,
    NmpcParameters,
    Stagewise,
    period_function,
)
from rt_controller.config import MpcSettings
from rt_controller.control.knots import place_knots
from rt_controller.control.mpc import Mpc
from rt_controller.control.terms import constrain_inputs

HORIZON = 8
QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}


LIMITS = constrain_inputs(place_knots(1, 1))


def parameters() -> NmpcParameters:
    upper = np.tile(LIMITS.upper, (HORIZON, 1))
    upper[:, 1] = 0.0
    reference = np.zeros((HORIZON, 5))
    reference[:, 0] = 21.0
    motion = np.array([20.0, 0.05, 0.02, 0.2, 0.01])
    return NmpcParameters(motion, np.array([0.2, 0.0, 0.05]), upper, reference, 0.001)


@pytest.mark.parametrize(
    "name",
    ["plan", "prepare", "warm_up", "observe", "forget", "reset", "resume", "limit_solve_time"],
)
def test_a_nonlinear_controller_is_called_like_the_own_one(name):
    expected = inspect.signature(getattr(Mpc, name)).parameters
    assert list(inspect.signature(getattr(Nmpc, name)).parameters) == list(expected)


def test_without_inputs_a_car_on_a_straight_road_only_slows_down():
    period = period_function(np.ones(3))
    x = np.array(period([20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0)).ravel()
    assert 19.9 < x[0] < 20.0
    np.testing.assert_allclose(x[1:], 0.0, atol=1e-12)


def test_steering_left_yaws_left_and_a_left_curve_makes_the_heading_error_negative():
    period = period_function(np.ones(3))
    turned = np.array(period([20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.3], 0.0)).ravel()
    assert turned[2] > 0.0
    curve = np.array(period([20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.01)).ravel()
    assert curve[4] < 0.0


def test_both_formulations_have_the_same_plan():
    plans = []
    for formulation in (Stagewise, Condensed):
        settings = MpcSettings()
        program = formulation(HORIZON, settings.cost())
        program.update_vectors(parameters())
        solver = ca.nlpsol("test", "ipopt", program.functions, QUIET)
        found = solver(
            x0=program.z,
            p=program.parameters,
            lbx=program.lower,
            ubx=program.upper,
            lbg=program.row_lower,
            ubg=program.row_upper,
        )
        assert solver.stats()["success"]
        program.z[:] = np.array(found["x"]).ravel()
        plan = np.zeros((HORIZON, 3))
        program.read_inputs(plan)
        plans.append(plan)
    np.testing.assert_allclose(plans[0] / LIMITS.scale, plans[1] / LIMITS.scale, atol=1e-4)
    changes = np.diff(plans[0] / LIMITS.scale, axis=0, prepend=parameters().previous[None])
    assert np.all(np.abs(changes) <= LIMITS.slew + 1e-6)


def test_the_last_solution_is_shifted_by_one_period():
    for formulation in (Stagewise, Condensed):
        program = formulation(HORIZON, MpcSettings().cost())
        program.z[:] = np.arange(program.z.size)
        plan, later = np.zeros((HORIZON, 3)), np.zeros((HORIZON, 3))
        program.read_inputs(plan)
        program.update_vectors(parameters())
        program.read_inputs(later)
        np.testing.assert_array_equal(later[:-2], plan[1:-1])
