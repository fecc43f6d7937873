"""The page about a recorded drive, or about two of them side by side, from plain data."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.drive.table import Drive
from rt_controller.report.page import Page, Part, Plot, Section
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

SHOWN_EVENTS, SHOWN_CHECKS = 40, 8
"""of each drive on the page; the figures have all"""


class Event(NamedTuple):
    """A mode or a bit of the heartbeat, from its begin to its end."""

    name: str
    why: str
    begin_s: float
    """since the first tick"""
    end_s: float
    ticks: int


class CheckedQuantity(NamedTuple):
    """What a check compared with its threshold."""

    name: str
    unit: str
    threshold: float
    window_ticks: int
    """in a row above the threshold, before the check acts"""
    values: Array
    """(ticks,), NaN: nothing was compared"""

    @property
    def share(self) -> Array:
        """Of the threshold, (ticks,)."""
        return self.values / self.threshold


@dataclass(frozen=True, slots=True)
class ReportedDrive:
    """A recorded drive with all that its page shows."""

    name: str
    drive: Drive
    headline: tuple[str, ...]
    """how it went in a sentence; then when and why it was disturbed, and what to do"""
    notes: tuple[str, ...]
    """what limits the page"""
    events: tuple[Event, ...]
    upper: Array
    """(ticks, 3), largest input of each tick"""
    rates_per_s: Array
    """(ticks, 3), largest change of each input"""
    checks: tuple[CheckedQuantity, ...]
    times_us: Mapping[str, Array]
    """(ticks,) by the name of the stage, as the columns of `--ticks`"""
    state_age_ms: Array
    """(ticks,), NaN: none had arrived"""
    figures: Mapping[str, Any]
    """as in the summary of a drive"""

    def closest_checks(self) -> list[tuple[float, CheckedQuantity]]:
        """Largest share of the threshold of each check that compared something, falling."""
        found = [(np.nanmax(c.share), c) for c in self.checks if not np.isnan(c.values).all()]
        return sorted(((float(share), c) for share, c in found), key=lambda each: -each[0])


class _Figure(NamedTuple):
    name: str
    unit: str
    key: str
    """in the figures, with a dot before the part of a table"""
    scale: float = 1.0


_MM, _DEG = 1e3, degrees(1.0)
_FIGURES = (
    _Figure("lateral error, RMS", "mm", "ey_rms_m", _MM),
    _Figure("lateral error, peak", "mm", "ey_peak_m", _MM),
    _Figure("heading error, RMS", "deg", "epsi_rms_rad", _DEG),
    _Figure("heading error, peak", "deg", "epsi_peak_rad", _DEG),
    _Figure("speed error, RMS", "m/s", "vx_rms_mps"),
    _Figure("speed error, peak", "m/s", "vx_peak_mps"),
    _Figure("throttle at its limit", "s", "at_limit_s.throttle"),
    _Figure("brake at its limit", "s", "at_limit_s.brake_n"),
    _Figure("steering wheel at its limit", "s", "at_limit_s.steer_rad"),
    _Figure("begin of the safe stop", "s", "stop_s"),
    _Figure("ticks", "1", "ticks"),
    _Figure("ticks with another command in the replay", "1", "ticks_with_other_command"),
)
_TIMES = (
    _Figure("deadline misses", "1", "deadline_misses"),
    _Figure("skipped periods", "1", "skipped_ticks"),
    *(
        _Figure(f"{name}, {words}", "us", f"{field}.{key}")
        for name, field in (("step", "step_us"), ("lateness of the wake-up", "wake_us"))
        for words, key in (
            ("median", "p50"),
            ("99 %", "p99"),
            ("99.9 %", "p999"),
            ("largest", "max"),
        )
    ),
    *(
        _Figure(f"{name}, 99 %", "us", f"{field}.p99")
        for name, field in (
            ("receive", "receive_us"),
            ("check", "check_us"),
            ("plan", "plan_us"),
            ("of this the QP", "qp_us"),
            ("decide", "decide_us"),
            ("send", "send_us"),
        )
    ),
    _Figure("age of the state, median", "ms", "state_age_ms.p50"),
    _Figure("age of the state, largest", "ms", "state_age_ms.max"),
)
_FRAMES = (
    _Figure("wrong checksum or length", "1", "frames_received.crc_errors"),
    _Figure("repeated counter", "1", "frames_received.repeated"),
    _Figure("counter back, or too far ahead", "1", "frames_received.wrong_sequence"),
    _Figure("missing between two counters", "1", "frames_received.counter_gap_frames"),
    _Figure("values out of range", "1", "frames_received.out_of_range"),
    _Figure("lost in the receive buffer", "1", "frames_received.overflowed"),
    _Figure("missing in the log", "1", "log_frames_dropped"),
)


def drive_page(drives: Sequence[ReportedDrive]) -> Page:
    """The page about one drive, or about two with the same axes and the same clock.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    from rt_controller.report.player import draw_player
    from rt_controller.report.signal_figure import draw_checks, draw_signals, draw_times

    names = [each.name for each in drives]
    introduction = [text for each in drives for text in _introduction(each, len(drives) > 1)]
    sections = (
        Section("From above", (draw_player([(each.name, each.drive) for each in drives]),)),
        Section("Figures", (_figures_table("", _FIGURES, drives),)),
        Section("Signals against their bounds", (Plot(draw_signals(drives), _SIGNALS),)),
        Section(
            "Checks against their thresholds",
            (Plot(draw_checks(drives), _CHECKS), *(_checks_table(each) for each in drives)),
        ),
        Section(
            "Timing",
            (Plot(draw_times(drives), _HISTOGRAM), _figures_table("", _TIMES, drives)),
        ),
        Section(
            "Faults",
            (*(_events_part(each) for each in drives), _figures_table("Frames", _FRAMES, drives)),
        ),
    )
    return Page(f"Drive {' and '.join(names)}", sections, tuple(introduction))


_SIGNALS = (
    "Time since the first tick. Dashed: bounds; where a curve stays far within its bound, the "
    "bound is a text. Shaded: the plan was held, or the car was stopped."
)
_CHECKS = (
    "The checks that came closest to their thresholds, each relative to its own; a check acts "
    "after so many ticks in a row above it as its table says."
)
_HISTOGRAM = "Time of the step from its first received frame to its last sent one."


def _introduction(drive: ReportedDrive, is_named: bool) -> Iterator[str]:
    first, *others = drive.headline
    yield f"{drive.name}: {first}" if is_named else first
    yield from others
    yield from (f"Note: {note}" for note in drive.notes)


def _value(figures: Mapping[str, Any], figure: _Figure) -> float | None:
    found: Any = figures
    for part in figure.key.split("."):
        found = found[part]
    return None if found is None else figure.scale * found


def _differences(
    figures: Sequence[_Figure], drives: Sequence[ReportedDrive]
) -> Iterator[float | None]:
    """The second drive minus the first; None where one of them has no value."""
    for figure in figures:
        first, second = (_value(each.figures, figure) for each in drives)
        yield None if first is None or second is None else second - first


def _figures_table(
    title: str, figures: Sequence[_Figure], drives: Sequence[ReportedDrive]
) -> Table:
    """A row for each figure; of two drives with the difference."""
    columns = [[_value(each.figures, figure) for figure in figures] for each in drives]
    heads = ["" if len(drives) == 1 else each.name for each in drives]
    if len(drives) == 2:
        columns.append([*_differences(figures, drives)])
        heads.append("difference")
    rows = tuple(
        (
            figure.name if figure.unit == "1" else f"{figure.name} / {figure.unit}",
            *(NO_VALUE if value is None else format_number(value) for value in values),
        )
        for figure, *values in zip(figures, *columns, strict=True)
    )
    return Table(title, (Column("", is_text=True), *(Column(head) for head in heads)), rows)


def _checks_table(drive: ReportedDrive) -> Table:
    columns = (
        Column("check", is_text=True),
        Column("largest value"),
        Column("threshold"),
        Column("share", "%"),
        Column("at", "s"),
        Column("ticks in a row to act"),
    )
    rows = []
    closest = drive.closest_checks()
    for share, check in closest[:SHOWN_CHECKS]:
        at_s = drive.drive["time_s"][int(np.nanargmax(check.values))]
        name = check.name if check.unit == "1" else f"{check.name} / {check.unit}"
        rows.append((
            name,
            format_number(share * check.threshold),
            format_number(check.threshold),
            Cell(f"{100.0 * share:.0f}", status="bad" if share > 1.0 else ""),
            f"{at_s:.3f}",
            f"{check.window_ticks}",
        ))  # fmt: skip
    return Table(f"Checks of {drive.name}", columns, tuple(rows), _hidden(closest, rows))


def _events_part(drive: ReportedDrive) -> Part:
    """When each fault and each degraded mode began and ended."""
    if not drive.events:
        return f"{drive.name}: no fault bit was set, and the plan was never held."
    columns = (
        *(Column("from", "s"), Column("until", "s"), Column("ticks")),
        Column("mode or fault bit", is_text=True, width="short"),
        Column("why", is_text=True, width="long"),
    )
    rows: list[Row] = [
        (f"{each.begin_s:.3f}", f"{each.end_s:.3f}", f"{each.ticks}", each.name, each.why)
        for each in drive.events[:SHOWN_EVENTS]
    ]
    return Table(f"Faults of {drive.name}", columns, tuple(rows), _hidden(drive.events, rows))


def _hidden(found: Sequence[object], rows: Sequence[Row]) -> tuple[str, ...]:
    hidden = len(found) - len(rows)
    return (f"and {hidden} more; --json lists all",) if hidden else ()


def compared_figures(drives: Sequence[ReportedDrive]) -> dict[str, Any]:
    """The figures of the page for programs, of two drives with the differences."""
    found: dict[str, Any] = {
        "drives": [
            {
                **each.figures,
                "headline": each.headline,
                "notes": each.notes,
                "events": [event._asdict() for event in each.events],
                "checks": [
                    {
                        "check": check.name,
                        "largest": share * check.threshold,
                        "threshold": check.threshold,
                        "unit": check.unit,
                    }
                    for share, check in each.closest_checks()
                ],
            }
            for each in drives
        ]
    }
    if len(drives) == 2:
        listed = [each._replace(scale=1.0) for each in (*_FIGURES, *_TIMES, *_FRAMES)]
        keys = (each.key for each in listed)
        found["differences"] = dict(zip(keys, _differences(listed, drives), strict=True))
    return found
