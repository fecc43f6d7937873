"""Drives seen from above, in panels whose x and y have the same scale."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.plan_view import PlanView, corners, extent
from rt_controller.drive.table import Drive
from rt_controller.report.canvas import FAINT, PAGE_IN

CAR, TRAIL, CONE, EDGE, HORIZON = "#2f6fb3", "#9dc1e6", "#d9822b", "#5b6773", "#c0392b"
NOMINAL = "#c9d2da"
STYLES: Mapping[str, Any] = {
    "centre": {"color": EDGE, "linewidth": 0.8, "linestyle": ":", "label": "reference line"},
    "edge": {"color": EDGE, "linewidth": 1.0, "label": "lanes"},
    "nominal": {"color": NOMINAL, "linewidth": 1.0},
    "path": {"color": FAINT, "linewidth": 1.2, "linestyle": "--", "label": "path"},
    "cone": {"color": CONE, "linestyle": "", "marker": "^", "markersize": 3.5, "label": "cones"},
}
"""of the lines of a `PlanView`"""
HORIZONS = 7
"""shown in one picture"""
TALLEST_IN = 4.2
"""of a panel, without its names"""
PLACES = 24
"""with outline and time, about, along one drive"""


def head_height_in(views: Sequence[PlanView]) -> float:
    """Height of a panel as wide as the page that shows these drives."""
    low, high = extent(views)
    width_m, height_m = high - low
    return float(np.clip((PAGE_IN - 1.0) * height_m / width_m, 0.9, TALLEST_IN)) + 0.6


def set_window(axes: Axes, low: Array, high: Array) -> None:
    """Show the part between these corners (2,), or more of y where the scale asks for it."""
    width_m, height_m = high - low
    if height_m * (PAGE_IN - 1.0) > TALLEST_IN * width_m:
        axes.set_adjustable("box")  # a narrower panel, not one that is half empty
    axes.set_xlim(low[0], high[0], auto=True)
    axes.set_ylim(low[1], high[1], auto=True)


def draw_road(axes: Axes, view: PlanView) -> None:
    """Draw reference line, edges, path and cones of a drive."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    for kind, line in view.lines.items():
        if line.x_m.size:
            axes.plot(*line, **STYLES[kind])


def draw_along(axes: Axes, drive: Drive, view: PlanView) -> None:
    """Draw the outline of the car and the time in some places, and some predictions."""
    car, body = view.car, drive.body
    low, high = extent([view])
    apart_m = max(2.0 * (body.front_m + body.rear_m), float(max(high - low)) / PLACES)
    places = list[int]()
    for k in range(0, len(drive), round(1.0 / PERIOD_S)):
        away_m = np.hypot(car.x_m[places] - car.x_m[k], car.y_m[places] - car.y_m[k])
        if np.all(away_m >= apart_m):
            places.append(k)
    outlines = [np.transpose(corners(car, k, body)) for k in places]
    axes.add_collection(
        PolyCollection(outlines, facecolor=TRAIL, edgecolor=CAR, alpha=0.6, linewidth=0.6, zorder=3)
    )
    for k in places:
        yaw_rad = car.yaw_rad[k]
        axes.annotate(
            f"{drive['time_s'][k]:.0f} s",
            (car.x_m[k], car.y_m[k]),
            xytext=(-14.0 * np.sin(yaw_rad), 14.0 * np.cos(yaw_rad)),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7.5,
        )
    moving = [line for line in view.horizons.values() if np.ptp(line.x_m) + np.ptp(line.y_m)]
    for number, line in enumerate(moving[:: max(1, -(-len(moving) // HORIZONS))]):
        label = "" if number else "predicted"
        axes.plot(*line, color=HORIZON, linewidth=1.2, zorder=4, label=label)
