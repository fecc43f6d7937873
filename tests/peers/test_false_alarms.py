"""When a stop counts as a false alarm."""

import pytest

from benchmarks.false_alarms.conditions import conditions
from benchmarks.false_alarms.drive import DriveResult
from benchmarks.false_alarms.summary import figures_of, json_of
from rt_controller.safety.checks import Quantity

CONDITION = next(conditions(["straight"]))


def driven(unchecked_m: float | None, *failed: str, progress_m: float = 0.0) -> DriveResult:
    largest = {q.name.lower(): 0.0 for q in Quantity} | {"progress_step_m": progress_m}
    return DriveResult(CONDITION, 3600.0, 0.1, unchecked_m, failed, largest)


@pytest.mark.parametrize(
    ("result", "false_checks", "is_lost"),
    [
        (driven(None), (), False),
        (driven(0.5, "heading"), ("heading",), False),
        (driven(0.91, "heading", "tracking"), (), True),
        (driven(None, "heading"), ("heading",), False),
    ],
    ids=["no check failed", "keeps its path", "leaves its path", "unchecked drive had no end"],
)
def test_a_stop_is_right_if_the_car_leaves_its_path_without_checks_too(
    result: DriveResult, false_checks: tuple[str, ...], is_lost: bool
) -> None:
    assert result.false_checks == false_checks
    assert result.has_lost_path is is_lost


def test_cars_that_lose_their_path_are_counted_apart() -> None:
    drives = [driven(None, progress_m=0.005), driven(3.0, "progress", progress_m=1.0)]
    drives += [driven(0.1, "progress", progress_m=0.03)]
    row = next(row for row in figures_of(drives) if row.check == "progress")
    assert (row.largest, row.drives_with_false_alarm) == (0.03, 1)
    assert row.false_alarms_per_h == pytest.approx(1.0 / 3.0)
    figures = json_of(drives)
    assert figures["drives"] == 3
    assert figures["drives_with_false_alarm"] == 1
    assert figures["drives_that_lose_the_path_without_checks_too"] == 1
