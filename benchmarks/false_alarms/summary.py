"""Thresholds with their margins and false-alarm rates."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from benchmarks.false_alarms.drive import DriveResult
from rt_controller.report.table import Column, Table
from rt_controller.safety.checks import CHECKS, Reaction

ZERO_EVENTS_95 = 3.0
"""upper bound, with 95 % confidence, of the expected number of events of which none was seen"""
_PER_EVENT_95 = 2.0
"""each event that was seen raises the bound by about this"""


class CheckFigures(NamedTuple):
    """One check over all drives."""

    check: str
    threshold: float
    """in the unit at the end of the name of its quantity"""
    quantity: str
    largest: float
    largest_share_of_threshold: float
    drives_with_false_alarm: int
    false_alarms_per_h: float
    false_alarms_per_h_95_upper: float


def driven_h(found: Sequence[DriveResult]) -> float:
    """Simulated hours of driving."""
    return sum(each.driven_s for each in found) / 3600.0


def figures_of(found: Sequence[DriveResult]) -> list[CheckFigures]:
    """One row for each check that acts while driving."""
    hours = max(driven_h(found), 1e-9)
    rows = []
    sound = [each for each in found if not each.has_lost_path]
    for check in CHECKS:
        if check.reaction is Reaction.REFUSE:
            continue
        name = check.quantity.name.lower()
        largest = max((each.largest[name] for each in sound), default=0.0)
        count = sum(check.name in each.false_checks for each in found)
        bound = (ZERO_EVENTS_95 + _PER_EVENT_95 * count) / hours
        share = round(largest / check.threshold, 3)
        rows.append(
            CheckFigures(
                check.name, check.threshold, name, largest, share, count, count / hours, bound
            )
        )
    return rows


def table_of(found: Sequence[DriveResult]) -> Table:
    """The rows for reading."""
    names = ("check", "threshold", "largest", "share", "false alarms", "per hour, 95 % bound")
    rows = tuple(
        (
            row.check,
            f"{row.threshold:g}",
            f"{row.largest:.4g}",
            f"{row.largest_share_of_threshold:.2f}",
            f"{row.drives_with_false_alarm}",
            f"{row.false_alarms_per_h_95_upper:.2g}",
        )
        for row in figures_of(found)
    )
    lost = sum(each.has_lost_path for each in found)
    title = (
        f"{driven_h(found):.2f} h of driving, {len(found)} drives, of which {lost} ended in a stop "
        f"because the car left its path, with checks and without"
    )
    return Table(title, tuple(Column(name) for name in names), rows)


def json_of(found: Sequence[DriveResult]) -> dict[str, Any]:
    """The same for programs."""
    return {
        "driven_h": driven_h(found),
        "drives": len(found),
        "drives_with_false_alarm": sum(bool(each.false_checks) for each in found),
        "drives_that_lose_the_path_without_checks_too": sum(each.has_lost_path for each in found),
        "checks": [row._asdict() for row in figures_of(found)],
        "false_alarms": [each.figures() for each in found if each.false_checks],
    }
