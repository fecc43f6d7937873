"""The figure of one drive: where the car was, and what was sent."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.contract.files import atomic_write
from rt_controller.contract.signals import Mode
from rt_controller.drive.plan_view import plan_view
from rt_controller.drive.scenario import DrivenScenario
from rt_controller.drive.table import Drive

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KMH_PER_MPS = 3.6
CONE, LANE = "#d9822b", "#1f2933"
"""colours"""
MOVING = ".gif"
FORMATS = (".png", ".svg", ".pdf", MOVING)


def require_figure_file(file: Path) -> None:
    """Return if a figure can be drawn into a file of that name.

    Raises:
        ConfigError: the suffix is none of `FORMATS`.
        MissingExtraError: matplotlib is not installed.
    """
    if file.suffix.lower() not in FORMATS:
        raise ConfigError(
            f"{file}: expected a figure as one of {', '.join(FORMATS)}, found "
            f"{file.suffix or 'no suffix'}."
        )
    with needs_extra("report", "A figure"):
        import matplotlib  # noqa: F401


def draw_drive(drive: Drive, file: Path | None = None) -> "Figure":
    """The drive from above; over time: lateral position, its error, steering wheel, pedals, speed.

    Ticks in which the plan was held or the car was stopped are shaded.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ConfigError: `file` cannot be written, or its format is unknown.
    """
    if file is not None:
        require_figure_file(file)
    with needs_extra("report", "A figure"):
        from rt_controller.report.above import draw_above, head_height_in
        from rt_controller.report.canvas import FAINT, add_legend_above, figure_under_head

    view = plan_view(drive)
    figure, above, axes = figure_under_head(6, head_height_in([view]), 10.0)
    draw_above(above, drive, view)
    position, error, wheel, throttle, brake, speed = axes
    t = drive["time_s"]
    if drive.scenario is not None:
        _draw_course(position, drive, drive.scenario)
    position.plot(t, drive["path_ey_m"], color=FAINT, linestyle="--", label="path")
    position.plot(t, drive["ey_m"], label="car, as received")
    error.plot(t, drive["ey_m"] - drive["path_ey_m"])
    wheel.plot(t, np.degrees(drive["steer_rad"]))
    throttle.plot(t, drive["throttle"])
    brake.plot(t, drive["brake_n"])
    brake.set_ylim(-2.0, max(10.0, 1.05 * float(np.max(drive["brake_n"], initial=0.0))))
    speed.plot(t, KMH_PER_MPS * drive["path_vx_mps"], color=FAINT, linestyle="--", label="wanted")
    speed.plot(t, KMH_PER_MPS * drive["vx_mps"], label="car")
    is_degraded = [mode in (Mode.HOLD_PLAN, Mode.SAFE_STOP) for mode in drive.modes]
    names = (
        "e_y / m", "lateral error / m", "steering wheel / deg", "throttle / 1", "brake / N",
        "v_x / km/h",
    )  # fmt: skip
    for axis, name in zip(axes, names, strict=True):
        axis.set_ylabel(name)
        whole_height = axis.get_xaxis_transform()
        axis.fill_between(
            t, 0.0, 1.0, where=is_degraded, transform=whole_height, alpha=0.15, color="red"
        )
    add_legend_above(position)
    add_legend_above(speed)
    figure.align_ylabels(axes)
    speed.set_xlabel("time / s")
    name = "" if drive.scenario is None else f"{drive.scenario.name}, "
    figure.suptitle(
        f"{name}{drive.model}: {drive.ending}; lateral error RMS {drive.errors.ey_rms_m:.3f} m, "
        f"peak {drive.errors.ey_peak_m:.3f} m",
        x=0.01, ha="left", fontsize="medium",
    )  # fmt: skip
    if file is not None:
        try:
            with atomic_write(file) as out:
                if file.suffix.lower() == MOVING:
                    from rt_controller.report.drive_from_above import animate

                    out.write(animate(drive))
                else:
                    figure.savefig(out, format=file.suffix[1:].lower())
        except OSError as error:
            raise ConfigError(
                f"{file}: expected a file that can be written, found {error.strerror}. Free some "
                f"space, or name another file."
            ) from error
    return figure


def _draw_course(axis: "Axes", drive: Drive, scenario: DrivenScenario) -> None:
    """Draw cones and edges of lanes at the times at which the car passed them."""
    s_m, first = np.unique(drive["s_m"], return_index=True)
    time_s = drive["time_s"][first]
    edges = [
        (lane, ey_m)
        for lane in scenario.lanes
        if lane.start_m < s_m[-1]
        for ey_m in (lane.right_m, lane.left_m)
    ]
    for k, (lane, ey_m) in enumerate(edges):
        ends = np.interp((lane.start_m, lane.end_m), s_m, time_s)
        label = "" if k else "lanes"
        axis.plot(ends, (ey_m, ey_m), color=LANE, linewidth=0.8, linestyle=":", label=label)
    cones = [cone for cone in scenario.cones if s_m[0] <= cone.s_m <= s_m[-1]]
    if cones:
        at_s = np.interp([cone.s_m for cone in cones], s_m, time_s)
        axis.plot(
            at_s, [cone.ey_m for cone in cones], "^", color=CONE, markersize=4.0, label="cones"
        )
