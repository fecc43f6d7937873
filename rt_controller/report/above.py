"""Drives seen from above, in panels whose x and y have the same scale."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.plan_view import PlanView, corners
from rt_controller.drive.table import Drive
from rt_controller.report.canvas import FAINT, PAGE_IN, add_legend_above

CAR, TRAIL, CONE, EDGE, HORIZON = "#2f6fb3", "#9dc1e6", "#d9822b", "#5b6773", "#c0392b"
NOMINAL = "#c9d2da"
MARGIN_M, MARGIN = 8.0, 0.04
"""around the drive, at least, and as a share of its size"""
HORIZONS = 7
"""shown in one picture"""
LABELS = 12
"""of times, at most, along one drive"""


def head_height_in(views: Sequence[PlanView]) -> float:
    """Height of a panel as wide as the page that shows these drives."""
    low, high = _extent(views)
    width_m, height_m = high - low
    return float(np.clip((PAGE_IN - 1.0) * height_m / width_m, 0.9, 4.2)) + 0.6


def draw_above(axes: Axes, drive: Drive, view: PlanView) -> None:
    """Draw one drive: road, path, car, some predictions, and times along the way."""
    draw_road(axes, view)
    draw_car(axes, drive, view)
    low, high = set_window(axes, [view])
    label_times(axes, drive, view, float(max(high - low)) / LABELS)
    add_legend_above(axes)


def set_window(axes: Axes, views: Sequence[PlanView]) -> tuple[Array, Array]:
    """Lower left and upper right corner (2,) of the part that contains the whole drives."""
    low, high = _extent(views)
    axes.set_xlim(low[0], high[0], auto=True)  # the equal scale may widen either
    axes.set_ylim(low[1], high[1], auto=True)
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    return low, high


def draw_road(axes: Axes, view: PlanView) -> None:
    """Draw reference line, edges, path and cones of a drive."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.plot(*view.centre, color=NOMINAL, linewidth=0.7, linestyle=(0, (8, 6)))
    for number, edge in enumerate(view.edges):
        label = "" if number else "lanes"
        axes.plot(*edge, color=EDGE, linewidth=1.0, label=label)
    for edge in view.nominal:
        axes.plot(*edge, color=NOMINAL, linewidth=1.0)
    axes.plot(*view.path, "--", color=FAINT, linewidth=1.2, label="path")
    if view.cones.x_m.size:
        axes.plot(*view.cones, "^", color=CONE, markersize=3.5, label="cones")


def draw_car(axes: Axes, drive: Drive, view: PlanView) -> None:
    """Draw the way of the car, its outline about once a second, and some of its predictions."""
    car, name = view.car, "car" if drive.true_poses is not None else "car, as received"
    axes.plot(car.x_m, car.y_m, color=CAR, linewidth=1.4, label=name)
    body = drive.body
    apart_m = 1.5 * (body.front_m + body.rear_m)
    shown = _apart(car.x_m, car.y_m, round(1.0 / PERIOD_S), apart_m)
    outlines = [np.transpose(corners(view.car, k, body)) for k in shown]
    axes.add_collection(
        PolyCollection(outlines, facecolor=TRAIL, edgecolor=CAR, alpha=0.6, linewidth=0.6, zorder=3)
    )
    moving = [tick for tick, line in view.horizons.items() if np.ptp(line.x_m) + np.ptp(line.y_m)]
    for number, tick in enumerate(moving[:: max(1, -(-len(moving) // HORIZONS))]):
        label = "" if number else "predicted"
        line = view.horizons[tick]
        axes.plot(*line, color=HORIZON, linewidth=1.2, zorder=4, label=label)


def label_times(axes: Axes, drive: Drive, view: PlanView, apart_m: float) -> None:
    """Write the time beside the car where it is so far from all other labels."""
    car = view.car
    for k in _apart(car.x_m, car.y_m, round(1.0 / PERIOD_S), apart_m):
        side = np.array([-np.sin(car.yaw_rad[k]), np.cos(car.yaw_rad[k])])
        axes.annotate(
            f"{drive['time_s'][k]:.0f} s",
            (car.x_m[k], car.y_m[k]),
            xytext=14.0 * side,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7.5,
        )


def _extent(views: Sequence[PlanView]) -> tuple[Array, Array]:
    points = np.hstack([(view.car.x_m, view.car.y_m) for view in views])
    low, high = points.min(axis=1), points.max(axis=1)
    margin_m = max(MARGIN_M, MARGIN * float(max(high - low)))
    return low - margin_m, high + margin_m


def _apart(x_m: Array, y_m: Array, ticks: int, apart_m: float) -> list[int]:
    """Every so many ticks, those that are `apart_m` or more from all chosen before."""
    chosen = list[int]()
    for k in range(0, len(x_m), ticks):
        away_m = np.hypot(x_m[chosen] - x_m[k], y_m[chosen] - y_m[k])
        if np.all(away_m >= apart_m):
            chosen.append(k)
    return chosen
