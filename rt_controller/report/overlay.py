"""The figure of one drive or several of one road: from above, and curves over time."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import needs_extra
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.plan_view import extent, plan_view
from rt_controller.drive.table import Drive
from rt_controller.report.table import printed_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KMH_PER_MPS = 3.6
STRONG = 6
"""names with a colour of their own; the lines of the others are dashed"""
BOUND = "#c0392b"
SHADE = 0.18
"""opacity"""
LARGEST_RATIO = 3.0
"""of the largest peak to the second one, where several drives are drawn"""


class Curve(NamedTuple):
    """One quantity of a drive over time, (ticks,) each."""

    unit: str
    values: Array
    wanted: Array | None = None
    bound: Array | None = None
    """largest size; NaN: none"""


def curves_of(drive: Drive) -> dict[str, Curve]:
    """The curves that each drive has, by their name."""
    wheel_deg = np.degrees(drive["steer_rad"])
    steps_s = np.diff(drive["time_s"], prepend=drive["time_s"][:1] - PERIOD_S)
    speed_kmh, wanted_kmh = KMH_PER_MPS * drive["vx_mps"], KMH_PER_MPS * drive["path_vx_mps"]
    return {
        "lateral position": Curve("m", drive["ey_m"], drive["path_ey_m"]),
        "lateral error": Curve("m", drive.poses[:, 1] - drive["path_ey_m"]),
        "speed": Curve("km/h", speed_kmh, wanted_kmh),
        "speed error": Curve("km/h", speed_kmh - wanted_kmh),
        "steering wheel": Curve("deg", wheel_deg),
        "wheel rate": Curve("deg/s", np.diff(wheel_deg, prepend=wheel_deg[:1]) / steps_s),
        "throttle": Curve("1", drive["throttle"]),
        "brake": Curve("N", drive["brake_n"]),
    }


def overlay(drives: Mapping[str, Drive]) -> "Figure":
    """Where each drive was, its lateral error, speed error and steering wheel.

    Args:
        drives: at least one, by the name in the legend. They start at the same place of the same
            road, which is that of the first one.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    curves = [curves_of(drive) for drive in drives.values()]
    return draw_drives(drives, curves, ("lateral error", "speed error", "steering wheel"))


def draw_drives(
    drives: Mapping[str, Drive], curves: Sequence[Mapping[str, Curve]], shown: Sequence[str]
) -> "Figure":
    """The drives from above, and a panel for each curve shown; the ticks of a held plan are shaded.

    A single drive is drawn with its car, its predictions and times.

    Args:
        drives: as of `overlay`.
        curves: of each drive, by their name; a drive may lack some.
        shown: names of curves, from top to bottom.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with needs_extra("report", "A figure"):
        from rt_controller.report import above
        from rt_controller.report.canvas import (
            FAINT,
            add_legend_above,
            figure_under_head,
            line_styles,
        )

    names, views = list(drives), [plan_view(drive) for drive in drives.values()]
    styles = line_styles(names[:STRONG], names[STRONG:])
    head_in = above.head_height_in(views)
    figure, head, panels = figure_under_head(len(shown), head_in, 0.3 + 1.5 * len(shown))
    above.draw_road(head, views[0])
    for (name, drive), view in zip(drives.items(), views, strict=True):
        head.plot(view.car.x_m, view.car.y_m, label=name, **styles[name])
        if len(drives) == 1:
            above.draw_along(head, drive, view)
    above.set_window(head, *extent(views))
    colors = [styles[name]["color"] if len(names) > 1 else BOUND for name in names]
    if any(_is_degraded(drive).any() for drive in drives.values()):
        head.fill_between([], [], color=FAINT, alpha=SHADE, label="plan held, or car stopped")
    add_legend_above(head)
    for axis, curve_name in zip(panels, shown, strict=True):
        axis.margins(y=0.15)
        found = [
            (name, drive["time_s"], of_drive[curve_name])
            for (name, drive), of_drive in zip(drives.items(), curves, strict=True)
            if curve_name in of_drive
        ]
        for name, time_s, curve in found:
            if curve.wanted is not None:
                axis.plot(time_s, curve.wanted, "--", color=FAINT, linewidth=1.2)
            axis.plot(time_s, curve.values, **styles[name])
            label = f"{curve_name} / {printed_unit(curve.unit)}".replace(": ", ":\n")
            axis.set_ylabel(label, fontsize="small")
        if len(found) > 2:
            _limit_to_most(axis, {name: curve.values for name, _, curve in found})
        _draw_bounds(axis, [(time_s, curve) for _, time_s, curve in found])
        _shade(axis, list(drives.values()), colors)
    figure.align_ylabels(panels)
    panels[-1].set_xlabel("time / s")
    return figure


def _limit_to_most(axis: "Axes", curves: Mapping[str, Array]) -> None:
    """Cut off a curve whose peak is far above that of all others, so that these can be read."""
    peaks = {name: float(np.nanmax(np.abs(c), initial=0.0)) for name, c in curves.items()}
    *_, second, largest = sorted(peaks.values())
    if 0.0 < LARGEST_RATIO * second < largest:
        low, high = axis.get_ylim()
        axis.set_ylim(max(low, -LARGEST_RATIO * second), min(high, LARGEST_RATIO * second))
        text = f"cut off: {max(peaks, key=peaks.__getitem__)}, whose peak is {largest:.3g}"
        axis.set_title(text, loc="left", fontsize="small", pad=2.0)


def _draw_bounds(axis: "Axes", curves: Sequence[tuple[Array, Curve]]) -> None:
    """How near each curve comes to its bound; the bound is seen where one comes near."""
    axis.set_ylim(axis.get_ylim())
    shares = []
    for time_s, curve in curves:
        if curve.bound is None or np.isnan(curve.values / curve.bound).all():
            continue
        if np.nanmin(curve.bound) <= max(map(abs, axis.get_ylim())):
            shares.append(f"{100.0 * np.nanmax(np.abs(curve.values) / curve.bound):.0f} %")
        for sign in (1.0, -1.0):
            axis.plot(time_s, sign * curve.bound, "--", color=BOUND, linewidth=1.0)
    if shares:
        text = f"at most {' and '.join(shares)} of the bound"
        axis.set_title(text, loc="right", fontsize="small", color=BOUND, pad=2.0)


def _is_degraded(drive: Drive) -> NDArray[np.bool_]:
    return np.isin(drive["mode"], (Mode.HOLD_PLAN, Mode.SAFE_STOP))


def _shade(axis: "Axes", drives: Sequence[Drive], colors: Sequence[str]) -> None:
    """Mark when the plan was held or the car was stopped, of several drives one above the other."""
    for number, (drive, color) in enumerate(zip(drives, colors, strict=True)):
        is_degraded = _is_degraded(drive)
        is_degraded[1:] |= is_degraded[:-1]  # each lasts until the next tick
        bottom, top = (1.0 - (number + k) / len(drives) for k in (1, 0))
        axis.fill_between(
            drive["time_s"], bottom, top, where=is_degraded, color=color, alpha=SHADE,
            transform=axis.get_xaxis_transform(), linewidth=0.0,
        )  # fmt: skip
