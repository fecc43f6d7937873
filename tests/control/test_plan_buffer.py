"""The buffer returns the inputs of a plan in turn, and None after the last."""

import numpy as np

from rt_controller.contract.signals import ControlInput
from rt_controller.control.input_planner import PlanBuffer


def test_inputs_are_returned_in_turn_and_none_after_the_last() -> None:
    plan = PlanBuffer(3)
    inputs = np.arange(9.0).reshape(3, 3)
    assert plan.store(inputs) == ControlInput(0.0, 1.0, 2.0)
    assert plan.periods_held == 0
    assert plan.next() == ControlInput(3.0, 4.0, 5.0)
    assert plan.periods_held == 1
    assert plan.next() == ControlInput(6.0, 7.0, 8.0)
    assert plan.next() is None
    assert plan.next() is None
    assert plan.periods_held == 4


def test_skipped_periods_skip_inputs() -> None:
    plan = PlanBuffer(4)
    plan.store(np.arange(12.0).reshape(4, 3))
    assert plan.next(periods=3) == ControlInput(9.0, 10.0, 11.0)
    assert plan.periods_held == 3
    assert plan.next(periods=2) is None


def test_the_stored_plan_is_a_copy() -> None:
    plan = PlanBuffer(2)
    inputs = np.zeros((2, 3))
    plan.store(inputs)
    inputs[:] = 9.0
    assert plan.next() == ControlInput(0.0, 0.0, 0.0)


def test_without_a_plan_the_buffer_is_empty() -> None:
    plan = PlanBuffer(5)
    assert plan.next() is None
    assert plan.periods_held >= 5
