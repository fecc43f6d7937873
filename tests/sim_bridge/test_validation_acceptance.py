"""Lines of the acceptance table: which results pass."""

from math import nan

import pytest

from sim_bridge.validation.acceptance import (
    Goal,
    Line,
    LineResult,
    at_least,
    at_most,
    check,
    has_failed,
    near,
    within,
)


def result(line: Line) -> LineResult:
    return check(1, [line], "this car")[0]


def is_ok(
    reached: float, goal: Goal | None, car: str | None = None, is_judged: bool = True
) -> bool | None:
    return result(Line("a line", "deg", reached, goal, car, is_judged)).ok


@pytest.mark.parametrize(
    ("goal", "passes", "fails"),
    [
        (within(100.0, 0.05), (95.0, 100.0, 105.0), (94.9, 105.1)),
        (within(-0.6, 0.1), (-0.65, -0.55), (-0.67, -0.53, 0.6)),
        (near(8.5, 0.5, "s"), (8.0, 9.0), (7.99, 9.01)),
        (at_most(0.1), (0.1, -3.0), (0.101,)),
        (at_least(6.0), (6.0, 7.0), (5.0,)),
    ],
)
def test_numbers_within_the_bounds_of_a_goal_pass(
    goal: Goal, passes: tuple[float, ...], fails: tuple[float, ...]
) -> None:
    assert [is_ok(reached, goal) for reached in passes] == [True] * len(passes)
    assert [is_ok(reached, goal) for reached in fails] == [False] * len(fails)


def test_nan_fails_every_goal() -> None:
    for goal in (within(1.0, 0.5), near(1.0, 9.0, "s"), at_most(1.0), at_least(1.0)):
        assert is_ok(nan, goal) is False


def test_a_line_without_goal_or_judgement_is_reported() -> None:
    assert is_ok(3.0, None) is None
    assert is_ok(90.0, at_most(35.0), is_judged=False) is None


def test_a_goal_for_another_car_is_not_judged() -> None:
    assert is_ok(0.0, within(1.0, 0.05), car="another car") is None
    assert is_ok(0.0, within(1.0, 0.05), car="this car") is False


def test_the_table_fails_if_a_judged_line_fails() -> None:
    passed = result(Line("passed", "", 1.0, within(1.0, 0.1)))
    shown = result(Line("shown", "", 5.0, within(1.0, 0.1), is_judged=False))
    missed = result(Line("missed", "", 5.0, within(1.0, 0.1)))
    assert not has_failed([passed, shown])
    assert has_failed([passed, missed])


def test_a_result_has_the_bounds_of_its_goal() -> None:
    two_sided = result(Line("0-100 km/h", "s", 8.7, near(8.5, 0.5, "s")))
    assert (two_sided.low, two_sided.high, two_sided.tolerance) == (8.0, 9.0, "±0.5 s")
    one_sided = result(Line("bound", "mm", 1.0, at_most(5.0)))
    assert (one_sided.low, one_sided.high) == (None, 5.0)
