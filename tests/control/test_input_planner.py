"""The planner returns the inputs of a plan in turn, and none after the last."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from rt_controller.contract.signals import (
    AT_REST,
    NEUTRAL_INPUT,
    ControlInput,
    Mode,
    PathReference,
)
from rt_controller.control.input_planner import InputPlanner
from rt_controller.control.program import SolveStatus

PATH = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


class Planned:
    """An `Mpc` whose plans are known, and a law that leaves all to it."""

    law = Mode.NOMINAL
    iterations = solve_ns = 0
    lifted, most_plan_rad = None, 1.0
    status = SolveStatus.SOLVED

    def __init__(self, horizon: int) -> None:
        self.inputs = np.arange(3.0 * horizon).reshape(horizon, 3)

    def plan(self, *_: Any) -> SolveStatus:
        return self.status

    def limit_steering(self, *_: Any) -> None: ...

    def choose(self, *_: Any) -> Mode:
        return Mode.NOMINAL


def plan(planner: InputPlanner) -> ControlInput | None:
    return planner.plan(AT_REST, 0.0, PATH, None, NEUTRAL_INPUT, 1, stops=False).control


def test_inputs_are_returned_in_turn_and_none_after_the_last() -> None:
    mpc: Any = Planned(3)
    planner = InputPlanner(mpc, mpc)
    assert plan(planner) == (0.0, 1.0, 2.0)
    assert planner.periods_held == 0
    mpc.inputs[:] = 9.0  # the plan is a copy
    mpc.status = SolveStatus.NUMERICS
    assert plan(planner) == (3.0, 4.0, 5.0)
    assert planner.hold(1).control == (6.0, 7.0, 8.0)
    assert planner.hold(1).control is None
    assert planner.periods_held == 3


def test_skipped_periods_skip_inputs() -> None:
    mpc: Any = Planned(4)
    planner = InputPlanner(mpc, mpc)
    plan(planner)
    assert planner.hold(3).control == (9.0, 10.0, 11.0)
    assert planner.hold(2).control is None


def test_without_a_plan_there_is_no_input() -> None:
    mpc: Any = SimpleNamespace(inputs=np.zeros((5, 3)))
    planner = InputPlanner(mpc, mpc)
    assert planner.hold(1).control is None
    assert planner.periods_held >= 5
