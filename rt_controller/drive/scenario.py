"""What a simulated drive was asked to do, and the figures that its scenario asks for."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # the command lines read this module before they need numpy
    from rt_controller.contract.arrays import Array

EXIT_LIMIT = 8
"""exit code of a drive to its end that missed a limit of its scenario"""


class ConeAt(NamedTuple):
    """A cone on the road."""

    s_m: float
    ey_m: float


class LaneAt(NamedTuple):
    """A section that no part of the body may leave."""

    start_m: float
    end_m: float
    right_m: float
    """lateral position of its right edge"""
    left_m: float


class Outline(NamedTuple):
    """The car from above: a rectangle around its centre of gravity."""

    front_m: float = 1.90
    """from the centre of gravity to the front end"""
    rear_m: float = 2.45
    width_m: float = 1.80


class RoadLine(NamedTuple):
    """The reference line of the road from behind the start to ahead of the end of the drive."""

    s_m: "Array"
    """(n,), increasing"""
    curvature_per_m: "Array"
    half_width_m: "Array"
    """from the line to each edge of the road; NaN: not known"""


class DrivenScenario(NamedTuple):
    """The scenario of a drive and the car in it."""

    name: str
    plant: str
    """name of the plant; of the own car that of its parameters"""
    friction: float | None
    """of the whole road; None: it changes along the road or across it"""
    cones: tuple[ConeAt, ...] = ()
    lanes: tuple[LaneAt, ...] = ()
    road: RoadLine | None = None
    body: Outline = Outline()


class LateralError(NamedTuple):
    """Lateral position of the car minus that of its path."""

    rms_m: float
    peak_m: float

    @property
    def text(self) -> str:
        """Both for people."""
        return f"RMS {self.rms_m:.3f} m, peak {self.peak_m:.3f} m"


class CarFigure(NamedTuple):
    """One figure, and the limit that the scenario sets for it."""

    name: str
    """ends in its unit"""
    value: float
    """NaN if it does not apply to the drive, inf if it was not reached"""
    limit: float | None
    """worst value with which the drive passes; None: no limit"""
    is_kept: bool
    """True if the limit is kept, or there is none"""

    @property
    def text(self) -> str:
        """Value and limit for people."""
        if self.limit is None:
            return f"{self.value:.4g}"
        return f"{self.value:.4g} (limit {self.limit:g}{'' if self.is_kept else ', MISSED'})"


def limits_missed(figures: Iterable[CarFigure]) -> list[str]:
    """Names of the figures that do not keep their limit."""
    return [figure.name for figure in figures if not figure.is_kept]


def explain_missed(missed: Iterable[str]) -> str:
    """A message about the limits of a scenario that a drive missed."""
    return (
        f"expected a drive that keeps the limits of its scenario, found {', '.join(missed)} "
        f"missed; the figures are in the summary. Change the controller, or [limits]"
    )


def figures_to_json(figures: Iterable[CarFigure]) -> dict[str, Any]:
    """The figures, and the names of those with a missed limit, for a summary in JSON."""
    listed = list(figures)
    return {
        "car_figures": [figure._asdict() for figure in listed],
        "limits_missed": limits_missed(listed),
    }
