"""The nonlinear rivals solve what they are said to solve."""

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the extra [peers] is not installed")

import casadi as ca

from benchmarks.peers.nonlinear.condensed import Condensed
from benchmarks.peers.nonlinear.program import Moment, bounds_of, moving
from benchmarks.peers.nonlinear.stagewise import Stagewise
from rt_controller.config import MpcSettings
from rt_controller.contract.limits import INPUT_LIMITS

HORIZON = 8
QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}


def moment() -> Moment:
    ceilings = np.tile(bounds_of(INPUT_LIMITS).upper, (HORIZON, 1))
    ceilings[:, 1] = 0.0
    reference = np.zeros((HORIZON, 5))
    reference[:, 0] = 21.0
    motion = np.array([20.0, 0.05, 0.02, 0.2, 0.01])
    return Moment(motion, np.array([0.2, 0.0, 0.05]), ceilings, reference, 0.001)


def test_a_car_that_rolls_straight_on_only_slows_down():
    period = moving(np.ones(3))
    x = np.array(period([20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0)).ravel()
    assert 19.9 < x[0] < 20.0
    np.testing.assert_allclose(x[1:], 0.0, atol=1e-12)


def test_a_wheel_turned_left_turns_left_and_a_curve_asks_for_it():
    period = moving(np.ones(3))
    turned = np.array(period([20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.3], 0.0)).ravel()
    assert turned[2] > 0.0
    curve = np.array(period([20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.01)).ravel()
    assert curve[4] < 0.0  # the road turns away from under the car


def test_both_ways_of_posing_it_have_the_same_plan():
    plans = []
    for pose in (Stagewise, Condensed):
        settings = MpcSettings()
        program = pose(HORIZON, settings.cost(), INPUT_LIMITS)
        program.aim(moment())
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
        program.read(plan)
        plans.append(plan)
    limits = bounds_of(INPUT_LIMITS)
    np.testing.assert_allclose(plans[0] / limits.span, plans[1] / limits.span, atol=1e-4)
    changes = np.diff(plans[0] / limits.span, axis=0, prepend=moment().previous[None])
    assert np.all(np.abs(changes) <= limits.slew + 1e-6)


def test_the_last_solution_is_where_the_next_begins_one_period_on():
    for pose in (Stagewise, Condensed):
        program = pose(HORIZON, MpcSettings().cost(), INPUT_LIMITS)
        program.z[:] = np.arange(program.z.size)
        plan, later = np.zeros((HORIZON, 3)), np.zeros((HORIZON, 3))
        program.read(plan)
        program.aim(moment())
        program.read(later)
        np.testing.assert_array_equal(later[:-2], plan[1:-1])
