"""Every table and sentence that the documents have of the results, in Markdown."""

import re
from collections.abc import Callable, Container, Iterable
from functools import partial
from math import nan
from typing import Any

from benchmarks.figures import scenario_fields as fields
from benchmarks.figures.closed_loop import CONTROLLERS, MODELS, RIVALS, ROWS, Row, part_name
from benchmarks.figures.results import Figures, Pieces
from rt_controller.contract.signals import SYMBOLS
from rt_controller.report.table import Column, Table, format_number, to_markdown


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]], title: str = "") -> Table:
    columns = tuple(Column(head, is_text=True) for head in heads)
    return Table(title, columns, tuple(tuple(row) for row in rows))


def _markdown(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    return to_markdown(_table(heads, rows))


def by_controller(
    drives: Figures, text: str, rows: Iterable[str], controllers: Iterable[str]
) -> str:
    """A line for each row, a column for each controller; a safe stop is marked."""
    shown = tuple(controllers)

    def cell(controller: str, row: str) -> str:
        found = drives.get(part_name(controller, row))
        if found is None:
            return ""
        in_mm = {
            f"{name}m": 1e3 * x for name, x in found.items() if name[-2:] == "_m" and x is not None
        }
        return text.format(**found, **in_mm) + ("" if found["stop_s"] is None else ", stopped")

    lines = ([row, *(cell(controller, row) for controller in shown)] for row in rows)
    return _markdown(["drive", *(f"`{name}`" for name in shown)], lines)


def by_name(figures: Figures, name: str, head: str, left_out: Container[str] = ()) -> str:
    """A table of an imported piece without some columns and without empty rows, or its sentence."""
    table = figures[name]
    if isinstance(table, str):
        return table
    columns = [each for each in next(iter(table.values())) if each not in left_out]
    rows = {
        row: {each: cells[each] for each in columns}
        for row, cells in table.items()
        if any(cells[each] is not None for each in columns)
    }
    return to_markdown(rows_table(rows, head))


def rows_table(rows: Figures, head: str, title: str = "") -> Table:
    """A table of rows by name, all with the same columns."""
    columns = next(iter(rows.values()))
    lines = (
        (row.replace("_", " "), *(_text(cells[each]) for each in columns))
        for row, cells in rows.items()
    )
    return _table((head, *map(_head, columns)), lines, title)


HEADS = {
    **SYMBOLS,
    "ey_rms_m": "lateral error RMS, m",
    "ey_peak_m": "lateral error peak, m",
    "epsi_peak_rad": "heading error peak, rad",
    "speed_rms_mps": "speed error RMS, m/s",
    "wheel_rate_rms_degps": "steering wheel rate RMS, deg/s",
    "400_steps_s": "400 steps, s",
    "median_ms": "median, ms",
    "p99_ms": "p99, ms",
}
"""of columns, by the name in the figures"""


def _head(key: str) -> str:
    """The name of a column; of a state its symbol."""
    name, space, unit = key.partition(" ")
    return HEADS.get(name, name.replace("_", " ")) + space + unit


def _text(x: Any) -> str:
    """A number, several, a median of rounds, a value with its interval, or beside the paper's."""
    if isinstance(x, str | int):
        return str(x)
    if isinstance(x, list | tuple):
        return ", ".join(map(_text, x))
    if isinstance(x, dict) and "here" in x:
        return f"{_text(x['here'])}, paper {format_number(x['paper'], 7)}"
    if isinstance(x, dict) and "low" in x:
        return f"{_text(x['value'])} ({_text(x['low'])} to {_text(x['high'])})"
    number = x["median"] if isinstance(x, dict) else x
    return format_number(nan if number is None else number, 3)


def _drives(
    text: str, rows: Iterable[str], controllers: Iterable[str] = MODELS
) -> tuple[str, Callable[[Figures], str]]:
    shown, columns = tuple(rows), tuple(controllers)
    return "closed_loop", lambda drives: by_controller(drives, text, shown, columns)


def _rows(shown: Callable[[Row], object]) -> list[str]:
    return [row.name for row in ROWS if shown(row)]


_OF_README = re.compile(
    "lane change, [0-9]+ km/h$|slalom|road course$|bend of (40 m to the left|400)|.*(0.6|vehicle 1)"
)
_LIKE_ANOTHER = re.compile("stop|standstill|.*(to the right|no preview|vehicle [23])")
"""drives that show nothing of the other controllers that another row does not"""
_STOP = "{stop_error_mm:.0f}, {creep_mm:.0f}, {mode_changes}, {pedal_changes}"
TABLES: dict[str, tuple[str, Callable[[Figures], str]]] = {
    "lane_changes": _drives(
        "{ey_rms_m:.3f}, {ey_peak_m:.3f}",
        ("lane change, 80 km/h",),
        [name for name in CONTROLLERS if name not in RIVALS],
    ),
    "rivals_short": _drives(
        "{ey_rms_m:.3f}", _rows(lambda row: _OF_README.match(row.name)), ("mdk-net", *RIVALS)
    ),
    "rivals": _drives(
        "{ey_rms_m:.3f}, {wheel_rate_rms_degps:.0f}",
        _rows(lambda row: not _LIKE_ANOTHER.match(row.name)),
        ("mdk-net", *RIVALS),
    ),
    "rivals_speed": _drives(
        "{speed_rms_mps:.2f}, {speed_peak_mps:.2f}",
        _rows(lambda row: row.changes_speed),
        ("mdk-net", *RIVALS),
    ),
    "lateral_error": _drives(
        "{ey_rms_m:.3f}, {ey_peak_m:.3f}", _rows(lambda row: not row.has_stop)
    ),
    "speed_and_wheel": _drives(
        "{speed_rms_mps:.2f}, {wheel_rate_rms_degps:.0f}",
        _rows(lambda row: not (row.has_stop or row.settled_s or row.conditions)),
    ),
    "settled_offset": _drives("{ey_settled_mm:.0f}", _rows(lambda row: row.settled_s)),
    "stopping": _drives(_STOP, _rows(lambda row: row.has_stop)),
    **{
        name: (piece, partial(by_name, name=name, head=head, left_out=left_out))
        for piece, name, head, left_out in (
            ("evaluation", "mse", "model", ()),
            ("evaluation", "mse_ratios", "baseline", tuple(SYMBOLS)),
            ("evaluation", "mse_sets", "test set", ("number", "ds", "geometric_mean_without_ds")),
            ("fault_matrix", "fault_matrix", "", ()),
            ("false_alarms", "false_alarms", "", ()),
            ("false_alarms", "alarm_margins", "check", ("drives with a false alarm",)),
            ("paper", "paper_overview", "in the paper", ()),
            ("paper", "paper_hyperparameters", "setting", ()),
            ("paper", "paper_losses", "preset", ()),
            ("paper", "paper_mse", "model", ()),
            ("paper", "paper_mse_ratios", "models", ()),
            ("paper", "paper_open_loop_rms", "model", ()),
            ("paper", "paper_closed_loop", "controller", ()),
            ("paper", "paper_times", "controller", ()),
        )
    },
}
"""by the name in the marker: the piece, and the text of its figures"""


def blocks(pieces: Pieces, complete: Iterable[str]) -> dict[str, str | None]:
    """The text of every table; None: its piece has not been measured as a whole."""
    known = set(complete)
    return {
        "scenario_fields": _markdown(
            ("field", "limits", "default", "meaning"), fields.field_rows()
        ),
        "scenario_kinds": _markdown(("kind", "fields"), fields.kind_rows()),
    } | {
        name: make(pieces[piece].get("all", pieces[piece])) if piece in known else None
        for name, (piece, make) in TABLES.items()
    }
