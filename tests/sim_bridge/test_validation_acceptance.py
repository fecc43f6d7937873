"""How a line of the acceptance table is judged."""

from math import nan

import pytest

from sim_bridge.validation import table
from sim_bridge.validation.acceptance import (
    Absolute,
    AtLeast,
    AtMost,
    Goal,
    Line,
    Relative,
    Tolerance,
    has_failed,
    judge,
)


def verdict_on(
    reached: float, goal: Goal | None, car: str | None = None, is_judged: bool = True
) -> bool | None:
    line: Line[float] = Line(2, "a line", "deg", lambda e: e, goal, car, is_judged)
    return judge(line, reached, "this car").ok


@pytest.mark.parametrize(
    ("tolerance", "target", "passes", "fails"),
    [
        (Relative(0.05), 100.0, (95.0, 100.0, 105.0), (94.9, 105.1)),
        (Relative(0.1), -0.6, (-0.65, -0.55), (-0.67, -0.53, 0.6)),
        (Absolute(0.5), 8.5, (8.0, 9.0), (7.99, 9.01)),
        (AtMost(), 0.1, (0.1, -3.0), (0.101,)),
        (AtLeast(), 6.0, (6.0, 7.0), (5.0,)),
    ],
)
def test_a_tolerance_lets_through_what_it_says(
    tolerance: Tolerance, target: float, passes: tuple[float, ...], fails: tuple[float, ...]
) -> None:
    goal = Goal(target, tolerance)
    assert [verdict_on(reached, goal) for reached in passes] == [True] * len(passes)
    assert [verdict_on(reached, goal) for reached in fails] == [False] * len(fails)


def test_what_could_not_be_measured_fails() -> None:
    for tolerance in (Relative(0.5), Absolute(9.0), AtMost(), AtLeast()):
        assert verdict_on(nan, Goal(1.0, tolerance)) is False


def test_a_line_without_a_goal_is_reported() -> None:
    assert verdict_on(3.0, None) is None


def test_a_line_that_is_not_judged_is_reported_with_its_goal() -> None:
    assert verdict_on(90.0, Goal(35.0, AtMost()), is_judged=False) is None


def test_the_goal_of_another_car_is_not_held_against_this_one() -> None:
    assert verdict_on(0.0, Goal(1.0, Relative(0.05)), car="another car") is None
    assert verdict_on(0.0, Goal(1.0, Relative(0.05)), car="this car") is False


def test_a_goal_may_itself_be_measured() -> None:
    line: Line[tuple[float, float]] = Line(
        4, "against a peer", "deg/s", lambda e: e[0], lambda e: Goal(e[1], Relative(0.03))
    )
    assert judge(line, (10.2, 10.0), "this car").ok is True
    assert judge(line, (10.4, 10.0), "this car").ok is False


def test_only_a_missed_line_fails_the_table() -> None:
    goal = Goal(1.0, Relative(0.1))
    line: Line[float] = Line(1, "judged", "", lambda e: e, goal)
    shown: Line[float] = Line(6, "shown", "", lambda e: e, goal, is_judged=False)
    assert not has_failed([judge(line, 1.0, "car"), judge(shown, 5.0, "car")])
    assert has_failed([judge(line, 1.0, "car"), judge(line, 5.0, "car")])


def test_bounds_are_part_of_the_verdict() -> None:
    line: Line[float] = Line(7, "0-100 km/h", "s", lambda e: e, Goal(8.5, Absolute(0.5)))
    found = judge(line, 8.7, "car")
    assert (found.low, found.high, found.tolerance) == (8.0, 9.0, "±0.5 s")
    one_sided: Line[float] = Line(1, "bound", "mm", lambda e: e, Goal(5.0, AtMost()))
    assert (judge(one_sided, 1.0, "car").low, judge(one_sided, 1.0, "car").high) == (None, 5.0)


def test_the_table_names_each_line_once() -> None:
    names = [
        line.name
        for lines in (
            table.NUMERICS,
            table.CORNERING,
            table.LANE_CHANGE,
            table.peer_lines(0.01),
            table.peer_lines(-0.01),
            table.TRANSIENTS,
            table.DWELL,
            table.LONGITUDINAL,
        )
        for line in lines
    ]
    assert len(set(names)) == len(names)
