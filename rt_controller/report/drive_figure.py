"""The figure of one drive: where the car was, and what was sent."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.contract.files import atomic_write
from rt_controller.drive.table import Drive
from rt_controller.report.overlay import curves_of, draw_drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOVING = ".gif"
FORMATS = (".png", ".svg", ".pdf", MOVING)


def require_figure_file(file: Path, moves: bool = True) -> None:
    """Return if a figure can be drawn into a file of that name; `moves`: a moving one too.

    Raises:
        ConfigError: the suffix is none of `FORMATS`.
        MissingExtraError: matplotlib is not installed.
    """
    formats = FORMATS if moves else FORMATS[:-1]
    if file.suffix.lower() not in formats:
        raise ConfigError(
            f"{file}: expected a figure as one of {', '.join(formats)}, found "
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
    car = "car" if drive.true_poses is not None else "car, as received"
    shown = "lateral position", "lateral error", "steering wheel", "throttle", "brake", "speed"
    figure = draw_drives({car: drive}, [curves_of(drive)], shown)
    name = "" if drive.scenario is None else f"{drive.scenario.name}, "
    figure.suptitle(
        f"{name}{drive.model}: {drive.ending}; lateral error {drive.lateral_error.text}",
        x=0.01, ha="left", fontsize="medium",
    )  # fmt: skip
    if file is not None and file.suffix.lower() == MOVING:
        from rt_controller.report.drive_from_above import animate

        _write(file, animate(drive))
    elif file is not None:
        write_figure(file, figure)
    return figure


def write_figure(file: Path, figure: "Figure") -> None:
    """Write a figure in the format of the suffix of the file.

    Raises:
        ConfigError: the file cannot be written.
    """
    image = BytesIO()
    figure.savefig(image, format=file.suffix[1:].lower())
    _write(file, image.getvalue())


def _write(file: Path, content: bytes) -> None:
    try:
        with atomic_write(file) as out:
            out.write(content)
    except OSError as error:
        raise ConfigError(
            f"{file}: expected a file that can be written, found {error.strerror}. Free some "
            f"space, or name another file."
        ) from error
