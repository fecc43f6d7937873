"""Checks of the road and the initial state of a scenario, from whatever file they come."""

from collections.abc import Iterator
from math import degrees

from sim_bridge.scenario.limits import (
    FASTEST_KMH,
    KMH_PER_MPS,
    LARGEST_CURVATURE_PER_M,
    LARGEST_START_EPSI_DEG,
    LARGEST_START_EY_M,
    STEEPEST_BANK_DEG,
    STEEPEST_PERCENT,
)
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Start

_TOLERANCE = 1e-9
_FLATTER = "Choose a flatter road; flat = true leaves out bank and grade of an OpenDRIVE map."


def road_problems(road: Road) -> Iterator[str]:
    """A line for each of curvature, bank and grade that is out of its limits."""
    for name, table, factor, largest, unit, remedy in (
        ("curvature_per_m", road.curvature_per_m, 1.0, LARGEST_CURVATURE_PER_M, "1/m",
         f"Choose a road without such bends: the frames carry radii of at least "
         f"{1.0 / LARGEST_CURVATURE_PER_M:.0f} m."),
        ("bank_deg", road.bank_rad, degrees(1.0), STEEPEST_BANK_DEG, "deg", _FLATTER),
        ("grade_percent", road.grade, 100.0, STEEPEST_PERCENT, "%", _FLATTER),
    ):  # fmt: skip
        for point in (table.lowest(), table.highest()):
            value = factor * point.value
            if not abs(value) <= largest + _TOLERANCE:
                yield (
                    f"road.{name}: expected {-largest:g}..{largest:g} {unit}, found {value:.6g} "
                    f"at s = {point.x:.1f} m. {remedy}"
                )
                break


def start_problems(start: Start) -> Iterator[str]:
    """A line for each part of the initial state that is out of its limits."""
    for name, value, low, high in (
        ("speed_kmh", KMH_PER_MPS * start.speed_mps, 0.0, FASTEST_KMH),
        ("ey_m", start.ey_m, -LARGEST_START_EY_M, LARGEST_START_EY_M),
        ("epsi_deg", degrees(start.epsi_rad), -LARGEST_START_EPSI_DEG, LARGEST_START_EPSI_DEG),
    ):
        if not low - _TOLERANCE <= value <= high + _TOLERANCE:
            yield f"initial.{name}: expected {low:g}..{high:g}, found {value:.6g}."
