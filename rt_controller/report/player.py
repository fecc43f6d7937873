"""What `player.js` needs to play drives from above: still lines, and what moves in each tick.

Places are in metres of the plane of `drive.plan_view`; lines are the `d` of an SVG path.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.drive.plan_view import Line, PlanView, outline, plan_view, readings
from rt_controller.drive.table import Drive, filled

DIGITS = 2
"""of places in m: 1 cm"""


class Player(NamedTuple):
    """Drives that a page can play."""

    content: str
    """JSON for the script"""


def play(drives: Mapping[str, Drive]) -> Player:
    """The drives, by name, from above: the road of the first, cars, predictions.

    A button leads to the begin of the first safe stop, else to the largest lateral error.
    """
    from rt_controller.report.canvas import STRONG  # matplotlib, which tables do without

    views = [plan_view(drive) for drive in drives.values()]
    content = {
        "lines": {kind: _path_data(line) for kind, line in views[0].lines.items()},
        "mark": _most_interesting(list(drives.values())),
        "drives": [
            {"name": name, "color": color, **_moving(drive, view)}
            for (name, drive), view, color in zip(drives.items(), views, STRONG, strict=False)
        ],
    }
    # "<" might end the element in which the content is
    return Player(json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"))


def _moving(drive: Drive, view: PlanView) -> dict[str, Any]:
    """The outline of the car, and a value for each tick; angles in degrees."""
    road_rad = np.interp(drive.poses[:, 0], view.road.s_m, view.road.heading_rad)
    return {
        "outline": _path_data(outline(drive.body)),
        "time_s": _rounded(drive["time_s"], 3),
        "x": _rounded(view.car.x_m),
        "y": _rounded(view.car.y_m),
        "yaw_deg": _rounded(np.degrees(view.car.yaw_rad)),
        "road_deg": _rounded(np.degrees(road_rad)),
        "text": readings(drive),
        "horizons": {tick: _path_data(line) for tick, line in view.horizons.items()},
    }


def _rounded(values: Array, digits: int = DIGITS) -> list[float]:
    return np.round(values, digits).tolist()  # type: ignore[no-any-return]


def _most_interesting(drives: list[Drive]) -> tuple[str, float]:
    """What happens there, and the time in s."""
    for drive in drives:
        if drive.stop_tick is not None:
            return "safe stop", float(drive["time_s"][drive.stop_tick])
    error_m = np.abs(filled(drives[0].poses[:, 1] - drives[0]["path_ey_m"]))
    return "largest lateral error", float(drives[0]["time_s"][np.argmax(error_m)])


def _path_data(line: Line) -> str:
    """The line for SVG; a part of one point, which is a dot, has a length of 0."""
    texts, is_begin = list[str](), True
    for x, y in zip(*(_rounded(each) for each in line), strict=True):
        is_gap = np.isnan(x) or np.isnan(y)
        if not is_gap:
            texts.append(f"M{x},{y}h0" if is_begin else f"L{x},{y}")
        is_begin = is_gap
    return "".join(texts)
