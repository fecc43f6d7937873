"""Every table and sentence that the documents have of the results, in Markdown."""

from collections.abc import Callable, Iterable
from functools import partial
from math import nan
from typing import Any

from benchmarks.figures.closed_loop import CONTROLLERS, MODELS, RIVALS, ROWS, part_name
from benchmarks.figures.results import Figures, Pieces
from rt_controller.report.table import Column, Table, format_number, to_markdown


def _markdown(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    columns = tuple(Column(head, is_text=True) for head in heads)
    return to_markdown(Table("", columns, tuple(tuple(row) for row in rows)))


def by_controller(
    drives: Figures, text: Callable[[Figures], str], rows: Iterable[str], controllers: Iterable[str]
) -> str:
    """A line for each row, a column for each controller; a safe stop is marked."""
    shown = tuple(controllers)

    def cell(controller: str, row: str) -> str:
        found = drives.get(part_name(controller, row))
        if found is None:
            return ""
        return text(found) + ("" if found["stop_s"] is None else ", stopped")

    lines = ([row, *(cell(controller, row) for controller in shown)] for row in rows)
    return _markdown(["drive", *(f"`{name}`" for name in shown)], lines)


def by_name(figures: Figures, name: str, head: str, only: Iterable[str] = ()) -> str:
    """A table of an imported piece, or its sentence."""
    table = figures[name]
    if isinstance(table, str):
        return table
    shown = {row: table[row] for row in only or table if row in table}
    heads = [_head(each) for each in next(iter(shown.values()))]
    lines = ((row.replace("_", " "), *map(_text, cells.values())) for row, cells in shown.items())
    return _markdown((head, *heads), lines)


SYMBOLS = {"vx": "v_x", "vy": "v_y", "yaw_rate": "yaw rate", "ds": "Δs", "ey": "e_y", "epsi": "e_ψ"}
UNITS = {"": "", "kmh": "km/h", "degps": "deg/s", "m": "m", "deg": "deg"}


def _head(key: str) -> str:
    """The name of a column; of a state or its squared error the symbol and the unit."""
    state, _, unit = key.removesuffix("_squared").partition("_")
    if key.startswith("yaw_rate"):
        state, unit = "yaw_rate", key.removesuffix("_squared").removeprefix("yaw_rate").strip("_")
    if state not in SYMBOLS or unit not in UNITS:
        return key.replace("_", " ")
    shown = f"({UNITS[unit]})²" if key.endswith("_squared") else UNITS[unit]
    return f"{SYMBOLS[state]} {shown}".strip()


def _text(x: Any) -> str:
    """A number, a median of rounds, or a value with its interval."""
    if isinstance(x, str | int):
        return str(x)
    if isinstance(x, dict) and "low" in x:
        return f"{_text(x['value'])} ({_text(x['low'])} to {_text(x['high'])})"
    number = x["median"] if isinstance(x, dict) else x
    return format_number(nan if number is None else number, 3)


def _lateral(found: Figures) -> str:
    return f"{found['ey_rms_m']:.3f}, {found['ey_peak_m']:.3f}"


def _lateral_rms(found: Figures) -> str:
    return f"{found['ey_rms_m']:.3f}"


def _lateral_and_wheel(found: Figures) -> str:
    return f"{found['ey_rms_m']:.3f}, {found['wheel_rate_rms_degps']:.0f}"


def _speed_and_wheel(found: Figures) -> str:
    return f"{found['speed_rms_mps']:.2f}, {found['wheel_rate_rms_degps']:.0f}"


def _settled(found: Figures) -> str:
    return f"{1e3 * found['ey_settled_m']:.0f}"


def _stop(found: Figures) -> str:
    return (
        f"{1e3 * found['stop_error_m']:.0f}, {1e3 * found['creep_m']:.0f}, "
        f"{found['mode_changes']}, {found['pedal_changes']}"
    )


def _drives(
    text: Callable[[Figures], str],
    shown: Callable[[str], bool] = lambda row: True,
    controllers: Iterable[str] = MODELS,
) -> tuple[str, Callable[[Figures], str]]:
    rows = tuple(row.name for row in ROWS if shown(row.name))
    return "closed_loop", partial(by_controller, text=text, rows=rows, controllers=controllers)


_LANE_CHANGES = {row.name for row in ROWS[:3]}
_OF_README = {
    *_LANE_CHANGES,
    *(row.name for row in ROWS if row.name in ("slalom", "road course", "bend of 100 m, 60 km/h")),
    *(row.name for row in ROWS if "friction 0.6" in row.name or "vehicle 1" in row.name),
}
_MOVING = {row.name for row in ROWS if not row.has_stop}
_SETTLED = {row.name for row in ROWS if row.settled_s}
_STOPS = {row.name for row in ROWS if row.has_stop}
_SHORT = ("mdk-net", "edmd-bilinear", "mdk-net-paper", "lti")
TABLES: dict[str, tuple[str, Callable[[Figures], str]]] = {
    "lane_changes": _drives(
        _lateral, _LANE_CHANGES.__contains__, [name for name in CONTROLLERS if name not in RIVALS]
    ),
    "rivals_short": _drives(_lateral_rms, _OF_README.__contains__, ("mdk-net", *RIVALS[::2])),
    "rivals": _drives(_lateral_and_wheel, _MOVING.__contains__, ("mdk-net", *RIVALS)),
    "lateral_error": _drives(_lateral),
    "speed_and_wheel": _drives(_speed_and_wheel),
    "settled_offset": _drives(_settled, _SETTLED.__contains__),
    "stopping": _drives(_stop, _STOPS.__contains__),
    "mse_short": ("evaluation", partial(by_name, name="mse", head="model", only=_SHORT)),
    **{
        name: (piece, partial(by_name, name=name, head=head))
        for piece, name, head in (
            ("evaluation", "mse", "model"),
            ("evaluation", "mse_ratios", "baseline"),
            ("evaluation", "mse_slices", "trajectories"),
            ("fault_matrix", "fault_matrix", ""),
            ("false_alarms", "false_alarms", ""),
            ("false_alarms", "alarm_margins", "check"),
            ("solvers", "solvers", "solver"),
            ("cadence", "cadence", "variant and stage"),
        )
    },
}
"""by the name in the marker: the piece, and the text of its figures"""


def blocks(pieces: Pieces, complete: Iterable[str]) -> dict[str, str | None]:
    """The text of every table; None: its piece has not been measured as a whole."""
    known = set(complete)
    return {
        name: make(pieces[piece].get("all", pieces[piece])) if piece in known else None
        for name, (piece, make) in TABLES.items()
    }
