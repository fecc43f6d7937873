"""The picture of a drive from above that a page can play; without its script it stands still.

The picture is SVG in metres of the plane of `drive.plan_view`. The script `player.js` moves the
cars by the tables that are embedded beside it.
"""

import json
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.drive.plan_view import Line, PlanView, plan_view
from rt_controller.drive.scenario import Outline
from rt_controller.drive.table import Drive
from rt_controller.report.canvas import STRONG

WIDTH, HEIGHT = 800.0, 260.0
"""of the picture, in its own units"""
UNITS_PER_M, CAR_AT = 9.0, (240.0, 130.0)
"""of the picture around the car, and the place of the car in it"""
MARGIN_M = 8.0
"""around the whole drive"""
CONE_M = 0.3
DIGITS = 2
"""of places in m: 1 cm"""


class Player(NamedTuple):
    """A picture that can be played."""

    svg: str
    tables: str
    """JSON, for the script: what moves"""
    end_s: float
    start_s: float
    """shown at first"""
    legend: tuple[tuple[str, str], ...]
    """name and colour of each drive"""


def draw_player(drives: Sequence[tuple[str, Drive]]) -> Player:
    """The drives, each with its name, from above: road, lanes, path, cones, cars, predictions.

    It begins where the first safe stop does, else where the lateral error is largest.
    """
    views = [plan_view(drive) for _, drive in drives]
    tables = [_moving(name, drive, view) for (name, drive), view in zip(drives, views, strict=True)]
    start_s = _most_interesting_s(drives)
    legend = tuple((name, color) for (name, _), color in zip(drives, STRONG, strict=False))
    whole = _whole(views)
    world = _around(tables[0], _row(tables[0], start_s))
    shapes = [shape for view in views[:1] for shape in _road(view)]
    for number, (table, view) in enumerate(zip(tables, views, strict=True)):
        _, drive = drives[number]
        shapes += _car(table, drive.body, view, _row(table, start_s), legend[number][1])
    svg = (
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" '
        f'aria-label="The drive from above"><g class="world" transform="{world}">'
        f"{''.join(shapes)}</g></svg>"
    )
    content = {"drives": tables, "whole": whole, "scale": UNITS_PER_M, "place": CAR_AT}
    # "<" might end the element in which the tables are
    text = json.dumps(content, separators=(",", ":")).replace("<", "\\u003c")
    return Player(svg, text, max(table["time_s"][-1] for table in tables), start_s, legend)


def _moving(name: str, drive: Drive, view: PlanView) -> dict[str, Any]:
    """What the script needs of a drive, a value for each tick; angles in degrees."""
    error_mm = 1e3 * (drive["ey_m"] - drive["path_ey_m"])
    road_deg = np.degrees(np.interp(drive.poses[:, 0], view.road.s_m, view.road.heading_rad))
    columns = {
        "time_s": (drive["time_s"], 3),
        "x": (view.car.x_m, DIGITS),
        "y": (view.car.y_m, DIGITS),
        "yaw_deg": (np.degrees(view.car.yaw_rad), 2),
        "road_deg": (road_deg, 1),
        "speed_kmh": (3.6 * drive["vx_mps"], 1),
        "error_mm": (error_mm, 0),
        "wheel_deg": (np.degrees(drive["steer_rad"]), 1),
    }
    return {
        "name": name,
        **{key: _rounded(values, digits) for key, (values, digits) in columns.items()},
        "mode": [mode.name for mode in drive.modes],
        "horizons": {tick: _points(line) for tick, line in view.horizons.items()},
    }


def _rounded(values: Array, digits: int) -> list[float | None]:
    """Plain numbers; None for NaN, which JSON has not."""
    rounded = np.round(values, digits)
    return [value if np.isfinite(value) else None for value in rounded.tolist()]


def _most_interesting_s(drives: Sequence[tuple[str, Drive]]) -> float:
    for _, drive in drives:
        if drive.stop_tick is not None:
            return float(drive["time_s"][drive.stop_tick])
    drive = drives[0][1]
    error_m = np.abs(drive["ey_m"] - drive["path_ey_m"])
    return 0.0 if np.isnan(error_m).all() else float(drive["time_s"][np.nanargmax(error_m)])


def _row(table: dict[str, Any], time_s: float) -> int:
    return max(int(np.searchsorted(table["time_s"], time_s, side="right")) - 1, 0)


def _around(table: dict[str, Any], row: int) -> str:
    """The transform that shows the car at its place, its road to the right; as in the script."""
    x, y, road_deg = (table[key][row] for key in ("x", "y", "road_deg"))
    return (
        f"translate({CAR_AT[0]:g} {CAR_AT[1]:g}) scale({UNITS_PER_M:g} {-UNITS_PER_M:g}) "
        f"rotate({-road_deg:g}) translate({-x:g} {-y:g})"
    )


def _whole(views: Sequence[PlanView]) -> str:
    """The transform that shows the whole of all drives."""
    x = np.concatenate([view.car.x_m for view in views])
    y = np.concatenate([view.car.y_m for view in views])
    width_m, height_m = np.ptp(x) + 2 * MARGIN_M, np.ptp(y) + 2 * MARGIN_M
    scale = min(WIDTH / width_m, HEIGHT / height_m)
    centre_x, centre_y = 0.5 * (np.min(x) + np.max(x)), 0.5 * (np.min(y) + np.max(y))
    return (
        f"translate({0.5 * WIDTH:g} {0.5 * HEIGHT:g}) scale({scale:.4g} {-scale:.4g}) "
        f"translate({-centre_x:.2f} {-centre_y:.2f})"
    )


def _points(line: Line) -> str:
    """The `points` of SVG; gaps are left out."""
    known = np.isfinite(line.x_m) & np.isfinite(line.y_m)
    pairs = zip(line.x_m[known].tolist(), line.y_m[known].tolist(), strict=True)
    return " ".join(f"{x:.{DIGITS}f},{y:.{DIGITS}f}" for x, y in pairs)


def _road(view: PlanView) -> Iterator[str]:
    lines = [("centre", view.centre), ("path", view.path)]
    lines += [("edge", line) for line in view.edges] + [("nominal", line) for line in view.nominal]
    for kind, line in lines:
        yield f'<polyline class="{kind}" points="{_points(line)}"/>'
    for x, y in zip(view.cones.x_m.tolist(), view.cones.y_m.tolist(), strict=True):
        yield f'<circle class="cone" cx="{x:.{DIGITS}f}" cy="{y:.{DIGITS}f}" r="{CONE_M}"/>'


def _car(
    table: dict[str, Any], body: Outline, view: PlanView, row: int, color: str
) -> Iterator[str]:
    """The way that the car has come, its prediction and itself, as the script finds them."""
    way = Line(view.car.x_m[: row + 1], view.car.y_m[: row + 1])
    recent = (table["horizons"].get(k, "") for k in range(row, row - 4, -1))
    horizon = next(filter(None, recent), "")
    x, y, yaw_deg = (table[key][row] for key in ("x", "y", "yaw_deg"))
    front, rear, side = body.front_m, body.rear_m, 0.5 * body.width_m
    shoulder = front - 0.2 * (front + rear)
    corners = (-rear, -side), (shoulder, -side), (front, 0.0), (shoulder, side), (-rear, side)
    yield f'<g class="drive" style="color:{color}"><title>{escape(table["name"])}</title>'
    yield f'<polyline class="trail" points="{_points(way)}"/>'
    yield f'<polyline class="horizon" points="{horizon}"/>'
    yield (
        f'<polygon class="car" transform="translate({x:g} {y:g}) rotate({yaw_deg:g})" '
        f'points="{" ".join(f"{along:.2f},{left:.2f}" for along, left in corners)}"/></g>'
    )
