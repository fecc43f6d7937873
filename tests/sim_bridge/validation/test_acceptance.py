"""Lines of the acceptance table: which results pass, and which are not judged."""

from math import inf, nan
from typing import Any

import pytest

from rt_controller.report.table import to_markdown
from sim_bridge.validation.acceptance import (
    MANOEUVRES,
    TESTS,
    AcceptanceTest,
    Line,
    LineResult,
    acceptance_table,
    check_line,
    count_sentence,
)


def result(reached: float, car: str = "this car", **line: Any) -> LineResult:
    one = Line(name="a line", unit="s", **line)
    test = AcceptanceTest(
        title="A test",
        manoeuvre="braking",
        cars=("this car",),
        kind="measured",
        text="",
        source="a book",
        lines=(one,),
    )
    return check_line(1, test, one, reached, car)


NEAR = {"target": 8.5, "width": 0.5}
AT_MOST = {"target": 0.1, "bound": "at most"}
AT_LEAST = {"target": 6.0, "bound": "at least"}


@pytest.mark.parametrize(
    ("goal", "passes", "fails"),
    [
        ({"target": 100.0, "share": 0.05}, (95.0, 100.0, 105.0), (94.9, 105.1)),
        ({"target": -0.6, "share": 0.1}, (-0.65, -0.55), (-0.67, -0.53, 0.6)),
        (NEAR, (8.0, 9.0), (7.99, 9.01)),
        (AT_MOST, (0.1, -3.0), (0.101,)),
        (AT_LEAST, (6.0, 7.0), (5.0,)),
    ],
)
def test_numbers_within_the_bounds_of_a_target_pass(
    goal: dict[str, Any], passes: tuple[float, ...], fails: tuple[float, ...]
) -> None:
    assert [result(reached, **goal).ok for reached in passes] == [True] * len(passes)
    assert [result(reached, **goal).ok for reached in fails] == [False] * len(fails)


@pytest.mark.parametrize(
    ("line", "reached", "car", "reason", "is_within"),
    [
        (NEAR, nan, "this car", "no such value in this drive", None),
        (AT_LEAST, inf, "this car", "no such value in this drive", None),
        (NEAR, 8.5, "another car", "target of another car", None),
        (AT_MOST | {"not_judged": "known gap"}, 0.2, "this car", "known gap", False),
        (AT_MOST | {"not_judged": "known gap"}, 0.1, "this car", "known gap", True),
        ({}, 3.0, "this car", None, None),
    ],
)
def test_a_line_that_is_not_judged_says_why(
    line: dict[str, Any], reached: float, car: str, reason: str | None, is_within: bool | None
) -> None:
    found = result(reached, car, **line)
    assert (found.ok, found.not_judged, found.is_within) == (None, reason, is_within)


def test_misses_stay_visible_in_the_table_and_in_the_count() -> None:
    gap = result(5.0, **NEAR, not_judged="known gap")
    lines = [gap, result(nan, **NEAR), result(8.5, **NEAR, fitted=True), result(5.0, **NEAR)]
    assert count_sentence(lines) == (
        "1 of 2 judged lines pass. 1 of 2 judged lines were not fitted; 0 of these pass. 2 lines "
        "are reported only; 1 of these miss a target"
    )
    text = to_markdown(acceptance_table(lines))
    for words in ("| missed |", "not judged: known gap", "| not judged |", "MISSED", "| fitted |"):
        assert words in text
    assert "nan" not in text


def test_every_row_of_the_table_is_complete() -> None:
    for test in TESTS.values():
        assert test.manoeuvre in MANOEUVRES
        assert len({line.name for line in test.lines}) == len(test.lines)
        for line in test.lines:
            tolerances = [line.share, line.width, line.bound]
            assert sum(t is not None for t in tolerances) == (line.target is not None), line.name
            assert line.target is None or line.source or test.source, line.name
