"""`DrivenScenario`: what a simulated drive was asked to do, for its summary and its figure."""

from typing import NamedTuple


class ConeAt(NamedTuple):
    """A cone on the road."""

    s_m: float
    ey_m: float


class LaneAt(NamedTuple):
    """A section between cones that the car has to stay in."""

    start_m: float
    end_m: float
    right_m: float
    """lateral position of its right edge"""
    left_m: float


class DrivenScenario(NamedTuple):
    """The scenario of a drive and the car in it."""

    name: str
    plant: str
    """name of the plant; of the own car that of its parameters"""
    friction: float | None
    """of the whole road; None: it changes along the road or across it"""
    start_s_m: float = 0.0
    cones: tuple[ConeAt, ...] = ()
    lanes: tuple[LaneAt, ...] = ()
