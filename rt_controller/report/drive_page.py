"""The page about a recorded drive, or about two of them side by side, from plain data."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any, NamedTuple

from rt_controller.drive.table import Drive
from rt_controller.report.overlay import (
    BRAKE,
    ERROR,
    SPEED,
    THROTTLE,
    WHEEL,
    WHEEL_RATE,
    Curve,
    draw_drives,
)
from rt_controller.report.page import Page, Part, Plot, Section
from rt_controller.report.player import play
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

SHOWN_EVENTS, SHOWN_CHECKS, DRAWN_CHECKS = 40, 8, 4
"""of each drive on the page; the figures have all"""
STEP = "step / us"
"""label of the curve of its time"""


class ReportedDrive(NamedTuple):
    """A recorded drive with all that its page shows."""

    name: str
    drive: Drive
    curves: Mapping[str, Curve]
    """by label: those of each drive, the time of the step, and those of the checks"""
    figures: Mapping[str, Any]
    """as in `--json`: the summary of a drive, and `headline` (how it went, then when, why and what
    to do), `notes` (what limits the page), `events` (modes and fault bits), `checks` (the closest
    to its threshold first)"""


def check_label(name: str, unit: str) -> str:
    """Label of the curve of what this check compares with its threshold."""
    return f"check of\n{name} / {unit}"


_MM, _DEG = 1e3, degrees(1.0)
_FIGURES = (
    ("lateral error, RMS / mm", "ey_rms_m", _MM),
    ("lateral error, peak / mm", "ey_peak_m", _MM),
    ("heading error, RMS / deg", "epsi_rms_rad", _DEG),
    ("heading error, peak / deg", "epsi_peak_rad", _DEG),
    ("speed error, RMS / m/s", "vx_rms_mps", 1.0),
    ("speed error, peak / m/s", "vx_peak_mps", 1.0),
    ("throttle at its limit / s", "at_limit_s.throttle", 1.0),
    ("brake at its limit / s", "at_limit_s.brake_n", 1.0),
    ("steering wheel at its limit / s", "at_limit_s.steer_rad", 1.0),
    ("begin of the safe stop / s", "stop_s", 1.0),
    ("ticks", "ticks", 1.0),
    ("ticks with another command in the replay", "ticks_with_other_command", 1.0),
)
"""name, key with a dot before the part of a table, scale"""
_TIMES = (
    ("deadline misses", "deadline_misses", 1.0),
    ("skipped periods", "skipped_ticks", 1.0),
    ("step, median / us", "step_us.p50", 1.0),
    ("step, 99.9 % / us", "step_us.p999", 1.0),
    ("step, largest / us", "step_us.max", 1.0),
    ("lateness of the wake-up, median / us", "wake_us.p50", 1.0),
    ("lateness of the wake-up, 99.9 % / us", "wake_us.p999", 1.0),
    ("lateness of the wake-up, largest / us", "wake_us.max", 1.0),
    ("receive, 99 % / us", "receive_us.p99", 1.0),
    ("check, 99 % / us", "check_us.p99", 1.0),
    ("plan, 99 % / us", "plan_us.p99", 1.0),
    ("of this the QP, 99 % / us", "qp_us.p99", 1.0),
    ("decide, 99 % / us", "decide_us.p99", 1.0),
    ("send, 99 % / us", "send_us.p99", 1.0),
    ("age of the state, median / ms", "state_age_ms.p50", 1.0),
    ("age of the state, largest / ms", "state_age_ms.max", 1.0),
)
_FRAMES = (
    ("wrong checksum or length", "frames_received.crc_errors", 1.0),
    ("repeated counter", "frames_received.repeated", 1.0),
    ("counter back, or too far ahead", "frames_received.wrong_sequence", 1.0),
    ("missing between two counters", "frames_received.counter_gap_frames", 1.0),
    ("values out of range", "frames_received.out_of_range", 1.0),
    ("lost in the receive buffer", "frames_received.overflowed", 1.0),
    ("missing in the log", "log_frames_dropped", 1.0),
)
_CAPTION = (
    "From above, then over the time since the first tick: signals, the checks that came closest to "
    "their thresholds, and the time from the first received frame of a step to its last sent one. "
    "Grey and dashed: path and wanted speed. Red and dashed: the bound, where a curve comes near "
    "it. Shaded: the plan was held, or the car was stopped."
)


def drive_page(drives: Sequence[ReportedDrive]) -> Page:
    """The page about one drive, or about two with the same axes and the same clock.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    by_name = {each.name: each.drive for each in drives}
    closest = [check for each in drives for check in each.figures["checks"][:DRAWN_CHECKS]]
    checks = dict.fromkeys(check_label(each["check"], each["unit"]) for each in closest)
    labels = ERROR, SPEED, WHEEL, WHEEL_RATE, THROTTLE, BRAKE, *checks, STEP
    introduction = list[str]()
    for each in drives:
        first, *others = each.figures["headline"]
        introduction += [f"{each.name}: {first}" if len(drives) > 1 else first, *others]
        introduction += (f"Note: {note}" for note in each.figures["notes"])
    sections = (
        Section("From above", (play(by_name),)),
        Section("Figures", (_figures_table("", _FIGURES, drives),)),
        Section(
            "Over time",
            (Plot(draw_drives(by_name, [each.curves for each in drives], labels), _CAPTION),),
        ),
        Section("Checks against their thresholds", tuple(map(_checks_table, drives))),
        Section("Timing", (_figures_table("", _TIMES, drives),)),
        Section("Faults", (*map(_faults, drives), _figures_table("Frames", _FRAMES, drives))),
    )
    return Page(f"Drive {' and '.join(by_name)}", sections, tuple(introduction))


def compared_figures(drives: Sequence[ReportedDrive]) -> dict[str, Any]:
    """The figures of the page for programs, of two drives with the differences."""
    found: dict[str, Any] = {"drives": [each.figures for each in drives]}
    if len(drives) == 2:
        keys = [key for _, key, _ in (*_FIGURES, *_TIMES, *_FRAMES)]
        found["differences"] = {key: _values(key, drives)[-1] for key in keys}
    return found


def _values(key: str, drives: Sequence[ReportedDrive]) -> list[float | None]:
    """The figure of each drive; of two also the second minus the first."""
    values = list[float | None]()
    for each in drives:
        found: Any = each.figures
        for part in key.split("."):
            found = found[part]
        values.append(found)
    if len(values) == 2:
        first, second = values
        values.append(None if first is None or second is None else second - first)
    return values


def _figures_table(
    title: str, figures: Sequence[tuple[str, str, float]], drives: Sequence[ReportedDrive]
) -> Table:
    """A row for each figure; of two drives with the difference."""
    heads = [each.name for each in drives] + ["difference"] if len(drives) == 2 else [""]
    rows = tuple(
        (
            name,
            *(
                NO_VALUE if value is None else format_number(scale * value)
                for value in _values(key, drives)
            ),
        )
        for name, key, scale in figures
    )
    return Table(title, (Column("", is_text=True), *map(Column, heads)), rows)


def _checks_table(drive: ReportedDrive) -> Table:
    columns = (
        Column("check", is_text=True),
        Column("largest value"),
        Column("threshold"),
        Column("share", "%"),
        Column("at", "s"),
        Column("ticks in a row to act"),
    )
    checks = drive.figures["checks"]
    rows: list[Row] = [
        (
            f"{check['check']} / {check['unit']}",
            format_number(check["largest"]),
            format_number(check["threshold"]),
            Cell(f"{100.0 * share:.0f}", status="bad" if share > 1.0 else ""),
            f"{check['at_s']:.3f}",
            f"{check['window_ticks']}",
        )
        for check in checks[:SHOWN_CHECKS]
        for share in [check["largest"] / check["threshold"]]
    ]
    return Table(f"Checks of {drive.name}", columns, tuple(rows), _hidden(checks, rows))


def _faults(drive: ReportedDrive) -> Part:
    """When each fault and each degraded mode began and ended."""
    events = drive.figures["events"]
    if not events:
        return f"{drive.name}: no fault bit was set, and the plan was never held."
    columns = (
        *(Column("from", "s"), Column("until", "s"), Column("ticks")),
        Column("mode or fault bit", is_text=True, width="short"),
        Column("why", is_text=True, width="long"),
    )
    rows: list[Row] = [
        (f"{each['begin_s']:.3f}", f"{each['end_s']:.3f}", f"{each['ticks']}", each["name"],
         each["why"])
        for each in events[:SHOWN_EVENTS]
    ]  # fmt: skip
    return Table(f"Faults of {drive.name}", columns, tuple(rows), _hidden(events, rows))


def _hidden(found: Sequence[object], rows: Sequence[Row]) -> tuple[str, ...]:
    hidden = len(found) - len(rows)
    return (f"and {hidden} more; --json lists all",) if hidden else ()
