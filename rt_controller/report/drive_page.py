"""The page about a recorded drive, or about two of them side by side, from plain data."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any, NamedTuple

from rt_controller.drive.table import Drive
from rt_controller.report.overlay import Curve, draw_drives
from rt_controller.report.page import Page, Part, Plot, Section
from rt_controller.report.player import play
from rt_controller.report.table import NO_VALUE, Column, Table, format_number, printed_unit

SHOWN_EVENTS, SHOWN_CHECKS, DRAWN_CHECKS = 40, 8, 3
"""of each drive on the page; the figures have all"""


class ReportedDrive(NamedTuple):
    """A recorded drive with all that its page shows."""

    name: str
    drive: Drive
    curves: Mapping[str, Curve]
    """by name: those of each drive, "step" (its time), and "check: " with the name of each check"""
    figures: Mapping[str, Any]
    """as in `--json`: the summary of a drive, and `headline` (how it went, then when, why and what
    to do), `notes` (what limits the page), `events` (modes and fault bits), `checks` (the closest
    to its threshold first)"""


_MM, _DEG = 1e3, degrees(1.0)
_FIGURES = (
    ("lateral error, RMS / mm", "ey_rms_m", _MM),
    ("lateral error, peak / mm", "ey_peak_m", _MM),
    ("heading error, RMS / deg", "epsi_rms_rad", _DEG),
    ("heading error, peak / deg", "epsi_peak_rad", _DEG),
    ("speed error before a stop, RMS / m/s", "vx_rms_mps", 1.0),
    ("speed error before a stop, peak / m/s", "vx_peak_mps", 1.0),
    ("throttle at its limit / s", "at_limit_s.throttle", 1.0),
    ("brake at its limit / s", "at_limit_s.brake_n", 1.0),
    ("steering wheel at its limit / s", "at_limit_s.steer_rad", 1.0),
    ("begin of the safe stop / s", "stop_s", 1.0),
    ("ticks", "ticks", 1.0),
    ("deadline misses", "deadline_misses", 1.0),
    ("skipped periods", "skipped_ticks", 1.0),
    ("frames missing in the log", "log_frames_dropped", 1.0),
    ("age of the state, median / ms", "state_age_ms.p50", 1.0),
    ("age of the state, largest / ms", "state_age_ms.max", 1.0),
    ("ticks with another command in the replay", "ticks_with_other_command", 1.0),
)
"""name, key with a dot before the part of a table, scale"""
_STAGES = "wake", "receive", "check", "plan", "qp", "decide", "send", "step"
_TIMES = {
    "stage": Column("", is_text=True),
    "p50": Column("median", "µs"),
    "p99": Column("99 %", "µs"),
    "p999": Column("99.9 %", "µs"),
    "max": Column("largest", "µs"),
}
_CHECKS = {
    "check": Column("check", is_text=True),
    "largest": Column("largest value"),
    "threshold": Column("threshold"),
    "unit": Column("unit", is_text=True, width="short"),
    "share_percent": Column("share", "%"),
    "at_s": Column("at", "s"),
    "window_ticks": Column("ticks in a row to act"),
}
_EVENTS = {
    "begin_s": Column("from", "s"),
    "end_s": Column("until", "s"),
    "ticks": Column("ticks"),
    "name": Column("mode or fault bit", is_text=True, width="short"),
    "why": Column("why", is_text=True, width="long"),
}
"""key of the figures: column of the page"""
_REFUSED = (
    "A check refused states. Errors and places of the car are as received, with these states; a "
    "log does not have the true ones."
)
_CAPTION = (
    "From above, then over the time since the first tick: signals, the checks that came closest to "
    "their thresholds, and the time from the first received frame of a step to its last sent one. "
    "Grey and dashed: path and wanted speed. Red and dashed: the bound, where a curve comes near "
    "it. Shaded, of two drives in their colours: the plan was held, or the car was stopped."
)


def drive_page(drives: Sequence[ReportedDrive]) -> Page:
    """The page about one drive, or about two with the same axes and the same clock.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    is_received = {each.name: each.figures["errors_as_received"] for each in drives}
    by_label = {
        f"{each.name}, as received" if is_received[each.name] else each.name: each.drive
        for each in drives
    }
    errors = "error as received" if any(is_received.values()) else "error"
    figures = [(name.replace("error", errors), key, scale) for name, key, scale in _FIGURES]
    closest = [check for each in drives for check in each.figures["checks"][:DRAWN_CHECKS]]
    shown = (
        "lateral error", "speed", "steering wheel", "wheel rate", "throttle", "brake",
        *dict.fromkeys(f"check: {check['check']}" for check in closest), "step",
    )  # fmt: skip
    curves = [each.curves for each in drives]
    introduction = list[str]()
    for each in drives:
        first, *others = each.figures["headline"]
        introduction += [f"{each.name}: {first}" if len(drives) > 1 else first, *others]
        note_on = f"Note on {each.name}" if len(drives) > 1 else "Note"
        refused = (_REFUSED,) if is_received[each.name] else ()
        introduction += (f"{note_on}: {note}" for note in (*refused, *each.figures["notes"]))
    sections = (
        Section("From above", (play(by_label),)),
        Section("Figures", (_figures_table("", figures, drives),)),
        Section("Over time", (Plot(draw_drives(by_label, curves, shown), _CAPTION),)),
        Section(
            "Checks against their thresholds",
            tuple(
                _listed(f"Checks of {each.name}", each.figures["checks"], _CHECKS, SHOWN_CHECKS)
                for each in drives
            ),
        ),
        Section("Timing", tuple(map(_times_table, drives))),
        Section(
            "Faults",
            (
                *(
                    _listed(f"Faults of {each.name}", each.figures["events"], _EVENTS, SHOWN_EVENTS)
                    for each in drives
                ),
                _figures_table("Frames", _frames(drives), drives),
            ),
        ),
    )
    return Page(f"Drive {' and '.join(is_received)}", sections, tuple(introduction))


def compared_figures(drives: Sequence[ReportedDrive]) -> dict[str, Any]:
    """The figures of the page for programs, of two drives with the differences."""
    found: dict[str, Any] = {"drives": [each.figures for each in drives]}
    if len(drives) == 2:
        keys = [key for _, key, _ in (*_FIGURES, *_frames(drives))]
        keys += (f"{stage}_us.{part}" for stage in _STAGES for part in [*_TIMES][1:])
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


def _frames(drives: Sequence[ReportedDrive]) -> list[tuple[str, str, float]]:
    """Figures of frames that were lost or refused."""
    counts = drives[0].figures["frames_received"]
    return [(key.replace("_", " "), f"frames_received.{key}", 1.0) for key in counts]


def _times_table(drive: ReportedDrive) -> Part:
    times = {stage: drive.figures[f"{stage}_us"] for stage in _STAGES}
    rows = [{"stage": stage, **found} for stage, found in times.items() if any(found.values())]
    return _listed(f"Stages of {drive.name}", rows, _TIMES, len(rows))


def _listed(
    title: str, found: Sequence[Mapping[str, Any]], columns: Mapping[str, Column], most: int
) -> Part:
    """A row for each of them, up to so many."""
    if not found:
        return f"{title}: none."
    rows = tuple(
        tuple(
            format_number(value, 5) if isinstance(value, float) else printed_unit(str(value))
            for value in (each[key] for key in columns)
        )
        for each in found[:most]
    )
    hidden = len(found) - len(rows)
    notes = (f"and {hidden} more; --json lists all",) if hidden else ()
    return Table(title, tuple(columns.values()), rows, notes)
