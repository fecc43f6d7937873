"""The figure of several drives of one road: from above, and their errors over time."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rt_controller.contract.errors import needs_extra
from rt_controller.drive.plan_view import plan_view
from rt_controller.drive.table import Drive

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KMH_PER_MPS = 3.6
STRONG = 6
"""names with a colour of their own; the lines of the others are dashed"""


def overlay(drives: Mapping[str, Drive]) -> "Figure":
    """Where each drive was, its lateral error, speed error and steering wheel.

    Args:
        drives: at least one, by the name in the legend. They start at the same place of the same
            road, which is that of the first one.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with needs_extra("report", "A figure"):
        from rt_controller.report.above import draw_road, head_height_in, set_window
        from rt_controller.report.canvas import add_legend, figure_under_head, line_styles

    names, views = list(drives), [plan_view(drive) for drive in drives.values()]
    styles = line_styles(names[:STRONG], names[STRONG:])
    figure, above, axes = figure_under_head(3, head_height_in(views), 5.4)
    error, speed, wheel = axes
    draw_road(above, views[0])
    for (name, drive), view in zip(drives.items(), views, strict=True):
        style, t = styles[name], drive["time_s"]
        above.plot(view.car.x_m, view.car.y_m, label=name, **style)
        error.plot(t, drive.poses[:, 1] - drive["path_ey_m"], **style)
        speed.plot(t, KMH_PER_MPS * (drive["vx_mps"] - drive["path_vx_mps"]), **style)
        wheel.plot(t, np.degrees(drive["steer_rad"]), **style)
    set_window(above, views)
    labels = "lateral error / m", "speed error / km/h", "steering wheel / deg"
    for axis, label in zip(axes, labels, strict=True):
        axis.set_ylabel(label)
    figure.align_ylabels(axes)
    wheel.set_xlabel("time / s")
    add_legend(figure, above)
    return figure
