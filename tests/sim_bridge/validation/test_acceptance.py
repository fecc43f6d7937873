"""Lines of the acceptance table: which results pass."""

from math import nan
from typing import Any

import pytest
from pydantic import ValidationError

from sim_bridge.validation.acceptance import (
    TESTS,
    AcceptanceTest,
    Line,
    LineResult,
    check_line,
    count_sentence,
    has_failed,
)


def result(reached: float, **line: Any) -> LineResult:
    return check_line(1, Line(name="a line", unit="s", **line), reached, "this car")


WITHIN_5_PERCENT = {"target": 100.0, "share": 0.05}
WITHIN_10_PERCENT = {"target": -0.6, "share": 0.1}
NEAR = {"target": 8.5, "width": 0.5}
AT_MOST = {"target": 0.1, "bound": "at most"}
AT_LEAST = {"target": 6.0, "bound": "at least"}


@pytest.mark.parametrize(
    ("goal", "passes", "fails"),
    [
        (WITHIN_5_PERCENT, (95.0, 100.0, 105.0), (94.9, 105.1)),
        (WITHIN_10_PERCENT, (-0.65, -0.55), (-0.67, -0.53, 0.6)),
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


def test_nan_fails_every_target() -> None:
    for goal in (WITHIN_5_PERCENT, NEAR, AT_MOST, AT_LEAST):
        assert result(nan, **goal).ok is False


def test_a_line_without_target_or_judgement_is_reported() -> None:
    assert result(3.0).ok is None
    assert result(90.0, target=35.0, bound="at most", is_judged=False).ok is None


def test_a_target_for_another_car_is_not_judged() -> None:
    assert result(0.0, **NEAR, car="another car").ok is None
    assert result(0.0, **NEAR, car="this car").ok is False


def test_a_line_that_tyre_files_need_not_meet_is_reported_for_them() -> None:
    line = Line(
        name="a line", unit="s", is_judged_with_tyre_file=False, target=0.1, bound="at most"
    )
    assert check_line(11, line, 0.2, "this car").ok is False
    result = check_line(11, line, 0.2, "this car", has_tyre_file=True)
    assert (result.ok, result.is_within) == (None, False)


def test_a_target_can_be_the_value_of_the_reference_model() -> None:
    line = Line(name="yaw rate", target="reference", share=0.1)
    assert check_line(4, line, 5.4, "this car", reference=5.0).ok is True
    assert check_line(4, line, 5.6, "this car", reference=5.0).ok is False
    assert check_line(4, line, 5.0, "this car").ok is False


def test_the_table_fails_if_a_judged_line_fails() -> None:
    passed, missed = result(8.5, **NEAR), result(5.0, **NEAR)
    shown = result(5.0, **NEAR, is_judged=False)
    assert not has_failed([passed, shown])
    assert has_failed([passed, missed])


def test_a_result_has_the_bounds_of_its_target() -> None:
    two_sided = result(8.7, **NEAR)
    assert (two_sided.low, two_sided.high, two_sided.tolerance) == (8.0, 9.0, "±0.5 s")
    one_sided = result(1.0, target=5.0, bound="at most")
    assert (one_sided.low, one_sided.high) == (None, 5.0)


def test_a_line_takes_the_source_of_its_test_unless_it_has_one() -> None:
    own = Line(name="a line", source="a paper", **NEAR)
    assert check_line(1, own, 8.5, "this car", test_source="a book").source == "a paper"
    none = Line(name="a line", **NEAR)
    assert check_line(1, none, 8.5, "this car", test_source="a book").source == "a book"
    assert check_line(1, Line(name="a line"), 8.5, "this car", test_source="a book").source is None


def test_a_target_without_a_source_is_refused_by_the_name_of_its_line() -> None:
    lines = ({"name": "yaw rate", "target": 3.0, "share": 0.1}, {"name": "roll"})
    with pytest.raises(ValidationError, match="yaw rate"):
        AcceptanceTest.model_validate({"title": "A test", "text": "", "lines": lines})


def test_a_miss_that_is_not_judged_is_counted() -> None:
    """Of another car's target it is not known whether it should be met."""
    missed = result(5.0, **NEAR, is_judged=False)
    other = result(5.0, **NEAR, car="another car")
    fitted = result(8.5, **NEAR, fitted=True)
    free = result(5.0, **NEAR)
    assert (missed.ok, missed.is_within, other.is_within) == (None, False, None)
    assert count_sentence([missed, other, fitted, free, result(1.0)]) == (
        "1 of 2 judged lines pass. 1 of 2 judged lines were not fitted; 0 of these pass. 3 lines "
        "are reported only; 1 of these miss a target"
    )


def test_every_target_of_the_table_has_one_tolerance() -> None:
    for test in TESTS.values():
        for line in test.lines:
            tolerances = [line.share, line.width, line.bound]
            assert sum(t is not None for t in tolerances) == (line.target is not None), line.name
