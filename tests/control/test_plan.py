"""A plan is followed from its first input on, and ends."""

import numpy as np

from rt_controller.contract.signals import ControlInput
from rt_controller.control.plan import Plan


def test_a_plan_is_followed_input_by_input_and_runs_out() -> None:
    plan = Plan(3)
    inputs = np.arange(9.0).reshape(3, 3)
    assert plan.renew(inputs) == ControlInput(0.0, 1.0, 2.0)
    assert plan.periods_held == 0
    assert plan.follow() == ControlInput(3.0, 4.0, 5.0)
    assert plan.periods_held == 1
    assert plan.follow() == ControlInput(6.0, 7.0, 8.0)
    assert plan.follow() is None
    assert plan.follow() is None
    assert plan.periods_held == 4


def test_skipped_periods_are_skipped_in_the_plan_too() -> None:
    plan = Plan(4)
    plan.renew(np.arange(12.0).reshape(4, 3))
    assert plan.follow(periods=3) == ControlInput(9.0, 10.0, 11.0)
    assert plan.periods_held == 3
    assert plan.follow(periods=2) is None


def test_a_plan_keeps_its_own_copy() -> None:
    plan = Plan(2)
    inputs = np.zeros((2, 3))
    plan.renew(inputs)
    inputs[:] = 9.0
    assert plan.follow() == ControlInput(0.0, 0.0, 0.0)


def test_without_a_plan_there_is_nothing_to_follow() -> None:
    plan = Plan(5)
    assert plan.follow() is None
    assert plan.periods_held >= 5
