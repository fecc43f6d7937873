"""Signals, checks and times of one drive or two over a common axis."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import InputColumn, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.report.canvas import FAINT, add_legend, empty_figure, line_styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rt_controller.report.drive_page import ReportedDrive

KMH_PER_MPS = 3.6
BOUND = "#c0392b"
SHOWN_CHECKS = 4
FAR_BELOW = 0.2
"""of a bound: below it the bound would make a curve a flat line, and is a text"""
LEAST_SEEN = 0.05
"""of a bound, so that noise does not fill the panel"""


class _Panel(NamedTuple):
    """A signal of one drive, (ticks,) each."""

    name: str
    unit: str
    values: Array
    bound: Array | None = None
    """of the size; None: none is drawn"""
    wanted: Array | None = None


def _panels(reported: "ReportedDrive") -> tuple[_Panel, ...]:
    drive = reported.drive
    is_driven = drive["mode"] != Mode.STANDBY
    upper, rates = (
        np.where(is_driven[:, None], each, np.nan)
        for each in (reported.upper, reported.rates_per_s)
    )
    steer, throttle, brake = InputColumn.steer_rad, InputColumn.throttle, InputColumn.brake_n
    wheel_deg = np.degrees(drive["steer_rad"])
    steps_s = np.diff(drive["time_s"], prepend=drive["time_s"][0] - PERIOD_S)
    rate_degps = np.diff(wheel_deg, prepend=wheel_deg[0]) / steps_s
    tracking_m = next(each.threshold for each in reported.checks if each.name == "tracking")
    return (
        _Panel(
            "lateral error",
            "m",
            drive["ey_m"] - drive["path_ey_m"],
            np.full(len(drive), tracking_m),
        ),
        _Panel(
            "speed",
            "km/h",
            KMH_PER_MPS * drive["vx_mps"],
            wanted=KMH_PER_MPS * drive["path_vx_mps"],
        ),
        _Panel("steering wheel", "deg", wheel_deg, np.degrees(upper[:, steer])),
        _Panel("its rate", "deg/s", rate_degps, np.degrees(rates[:, steer])),
        _Panel("throttle", "%", 100.0 * drive["throttle"], 100.0 * upper[:, throttle]),
        _Panel("brake", "N", drive["brake_n"], upper[:, brake]),
    )


def draw_signals(drives: Sequence["ReportedDrive"]) -> "Figure":
    """Lateral error, speed, steering wheel and its rate, pedals against their bounds."""
    styles = line_styles([each.name for each in drives], ())
    rows = zip(*map(_panels, drives), strict=True)
    figure, axes = empty_figure(6, 1, 10.0, sharex=True)
    for axis, panels in zip(axes, rows, strict=True):
        for reported, panel in zip(drives, panels, strict=True):
            time_s = reported.drive["time_s"]
            axis.plot(time_s, panel.values, label=reported.name, **styles[reported.name])
            if panel.wanted is not None:
                label = "wanted speed" if reported is drives[0] else "_"  # once in the legend
                axis.plot(time_s, panel.wanted, "--", color=FAINT, linewidth=1.2, label=label)
        axis.set_ylabel(f"{panels[0].name} / {panels[0].unit}")
        _draw_bounds(axis, drives, panels)
        _shade(axis, drives)
    axes[-1].set_xlabel("time / s")
    figure.align_ylabels(axes)
    add_legend(figure, axes[1])
    return figure


def draw_checks(drives: Sequence["ReportedDrive"]) -> "Figure":
    """The checks of each drive that came closest to their thresholds, relative to these."""
    figure, axes = empty_figure(len(drives), 1, 0.4 + 2.4 * len(drives), sharex=True, sharey=True)
    for axis, reported in zip(axes, drives, strict=True):
        closest = [check for _, check in reported.closest_checks()[:SHOWN_CHECKS]]
        styles = line_styles([check.name for check in closest], ())
        for check in closest:
            style = {**styles[check.name], "linewidth": 1.2}
            axis.plot(reported.drive["time_s"], check.share, label=check.name, **style)
        axis.axhline(1.0, color=BOUND, linestyle="--", linewidth=1.0)
        _shade(axis, [reported])
        axis.set_ylim(0.0, 2.0)
        axis.set_ylabel("value / threshold")
        axis.set_title(reported.name, loc="left")
        if closest:  # a car that was never driven has none
            place = (1.0, 0.98)  # above the panel
            axis.legend(loc="lower right", bbox_to_anchor=place, ncols=SHOWN_CHECKS, frameon=False)
    axes[-1].set_xlabel("time / s")
    return figure


def draw_times(drives: Sequence["ReportedDrive"]) -> "Figure":
    """Distribution of the time of the step, and its course over the drive."""
    styles = line_styles([each.name for each in drives], ())
    figure, (histogram, course) = empty_figure(1, 2, 2.6)
    largest_us = max(float(np.max(each.times_us["step_us"])) for each in drives)
    for reported in drives:
        step_us, color = reported.times_us["step_us"], styles[reported.name]["color"]
        edges = np.linspace(0.0, largest_us, 60).tolist()
        histogram.hist(step_us, edges, color=color, alpha=0.6, label=reported.name)
        course.plot(reported.drive["time_s"], step_us, color=color, linewidth=0.8)
    histogram.set_yscale("log")
    histogram.set_xlabel("step / us")
    histogram.set_ylabel("ticks")
    course.set_xlabel("time / s")
    course.set_ylabel("step / us")
    add_legend(figure, histogram)
    return figure


def _draw_bounds(axis: "Axes", drives: Sequence["ReportedDrive"], panels: Sequence[_Panel]) -> None:
    """The bounds as lines where a signal comes near them, else as a text."""
    if panels[0].bound is None:
        return
    largest = max(float(np.nanmax(np.abs(panel.values), initial=0.0)) for panel in panels)
    bounds = [np.asarray(panel.bound) for panel in panels]
    least_bound = min(float(np.nanmin(each, initial=np.inf)) for each in bounds)
    if not np.isfinite(least_bound):  # never driven
        return
    if largest < FAR_BELOW * least_bound:
        text = f"largest {largest:.3g} of {least_bound:.3g} {panels[0].unit}"
        axis.set_title(text, loc="right", fontsize="small", color=BOUND, pad=2.0)
        least_bound = LEAST_SEEN * least_bound
    is_signed = any(np.nanmin(panel.values, initial=0.0) < 0.0 for panel in panels)
    for reported, bound in zip(drives, bounds, strict=True):
        for sign in (1.0, -1.0) if is_signed else (1.0,):
            time_s = reported.drive["time_s"]
            axis.plot(time_s, sign * bound, "--", color=BOUND, linewidth=1.0)
    # the bound of the wheel of a slow car is so wide that nothing else would be seen
    seen = 1.15 * max(largest, least_bound)
    axis.set_ylim(-seen if is_signed else -0.05 * seen, seen)


def _shade(axis: "Axes", drives: Sequence["ReportedDrive"]) -> None:
    """Mark when the plan was held or the car was stopped, of two drives one above the other."""
    whole_height = axis.get_xaxis_transform()
    for number, reported in enumerate(drives):
        is_degraded = np.isin(reported.drive["mode"], (Mode.HOLD_PLAN, Mode.SAFE_STOP))
        is_degraded[1:] |= is_degraded[:-1]  # each lasts until the next tick
        top, bottom = 1.0 - number / len(drives), 1.0 - (number + 1) / len(drives)
        axis.fill_between(
            reported.drive["time_s"], bottom, top, where=is_degraded, transform=whole_height,
            alpha=0.15, color="red", linewidth=0.0,
        )  # fmt: skip
