"""The figure of one drive: where the car was, and what was sent."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.contract.signals import Mode
from rt_controller.drive import Drive

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KMH_PER_MPS = 3.6
FORMATS = (".png", ".svg", ".pdf")


def require_figure_file(file: Path) -> None:
    """Return if a figure can be drawn into a file of that name.

    Raises:
        ConfigError: the suffix is none of .png, .svg, .pdf.
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
    """Lateral position and path, lateral error, steering wheel, pedals, speed over time.

    Ticks in which the plan was held or the car was stopped are shaded.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ConfigError: `file` cannot be written, or its format is unknown.
    """
    if file is not None:
        require_figure_file(file)
    with needs_extra("report", "A figure"):
        from rt_controller.report.canvas import FAINT, empty_figure

    figure, axes = empty_figure(5, 1, 9.0, sharex=True)
    position, error, wheel, pedals, speed = axes
    t = drive["time_s"]
    position.plot(t, drive["path_ey_m"], color=FAINT, linestyle="--", label="path")
    position.plot(t, drive["ey_m"], label="car")
    error.plot(t, drive["ey_m"] - drive["path_ey_m"])
    wheel.plot(t, np.degrees(drive["steer_rad"]))
    pedals.plot(t, drive["throttle"], label="throttle, 1")
    pedals.plot(t, drive["brake_n"] / 100.0, label="brake, 100 N")
    speed.plot(t, KMH_PER_MPS * drive["path_vx_mps"], color=FAINT, linestyle="--", label="wanted")
    speed.plot(t, KMH_PER_MPS * drive["vx_mps"], label="car")
    is_degraded = [mode in (Mode.HOLD_PLAN, Mode.SAFE_STOP) for mode in drive.modes]
    names = ("e_y / m", "lateral error / m", "steering wheel / deg", "pedals", "v_x / km/h")
    for axis, name in zip(axes, names, strict=True):
        axis.set_ylabel(name)
        whole_height = axis.get_xaxis_transform()
        axis.fill_between(
            t, 0.0, 1.0, where=is_degraded, transform=whole_height, alpha=0.15, color="red"
        )
    for axis in (position, pedals, speed):
        axis.legend(loc="upper right")
    speed.set_xlabel("time / s")
    position.set_title(
        f"{drive.model}: {drive.ending}; lateral error RMS {drive.errors.ey_rms_m:.3f} m, "
        f"peak {drive.errors.ey_peak_m:.3f} m",
        loc="left",
    )
    if file is not None:
        try:
            figure.savefig(file)
        except OSError as error:
            raise ConfigError(
                f"{file}: expected a file that can be written, found {error.strerror}."
            ) from error
    return figure
