"""The wanted speed: a profile over distance or time, and stops with a hold."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

from sim_bridge.scenario.table import Table, constant, through

STANDING_MPS = 0.1
"""a car below this speed counts as standing at its stop"""
STOP_WINDOW_M = 0.5
"""a car that stands at most so far from its target has stopped there"""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """A wanted speed over arc length or over time, with constant acceleration between its knots."""

    table: Table
    """speed in m/s over time, or its square over distance: both are linear between knots"""
    is_over_distance: bool = False

    def at(self, s_m: float, time_s: float) -> float:
        """The speed in m/s."""
        if self.is_over_distance:
            return sqrt(max(self.table.at(s_m), 0.0))
        return max(self.table.at(time_s), 0.0)

    @property
    def is_constant(self) -> bool:
        """True if the speed is the same everywhere."""
        return self.table.is_constant

    @property
    def highest_mps(self) -> float:
        """The largest speed of the profile."""
        highest = self.table.highest().value
        return sqrt(max(highest, 0.0)) if self.is_over_distance else highest


def constant_speed(mps: float) -> SpeedProfile:
    """The same speed everywhere."""
    return SpeedProfile(constant(mps))


def speed_over_distance(s_m: Sequence[float], mps: Sequence[float]) -> SpeedProfile:
    """The profile through knots over arc length, with constant acceleration between them."""
    return SpeedProfile(through(s_m, [v * v for v in mps]), is_over_distance=True)


class Stop(NamedTuple):
    """A place to stop at: brake to rest, hold, drive on."""

    at_s_m: float
    hold_s: float = inf
    """inf: to the end of the drive"""
    deceleration_mps2: float = 2.5
    acceleration_mps2: float = 2.0
    entry: str = ""
    """what a file calls it, such as "stops[0]"; "": it belongs to the speed"""


class Progress(NamedTuple):
    """How far a drive has come with its stops."""

    stops_done: int = 0
    standing_since_s: float | None = None
    """time at which the car came to rest at the stop where it is held now"""
    released_s: float | None = None
    """time at which it was last allowed to drive on"""

    @property
    def is_holding(self) -> bool:
        """True if the car stands at a stop."""
        return self.standing_since_s is not None


START = Progress()
"""before the first stop"""


def next_progress(
    now: Progress, stops: Sequence[Stop], s_m: float, vx_mps: float, time_s: float
) -> Progress:
    """The progress after the car was seen at `s_m` with `vx_mps`.

    A car that stands beyond its target is held and released too, so that the drive goes on.
    """
    if now.stops_done == len(stops):
        return now
    stop = stops[now.stops_done]
    if now.standing_since_s is None:
        has_arrived = s_m >= stop.at_s_m - STOP_WINDOW_M and abs(vx_mps) < STANDING_MPS
        return now._replace(standing_since_s=time_s) if has_arrived else now
    if time_s - now.standing_since_s < stop.hold_s:
        return now
    return Progress(now.stops_done + 1, None, time_s)


def reference_speed(
    profile: SpeedProfile, stops: Sequence[Stop], now: Progress, s_m: float, time_s: float
) -> float:
    """The wanted speed in m/s: that of the profile, limited by the stops."""
    if now.is_holding:
        return 0.0
    speed_mps = profile.at(s_m, time_s)
    if now.released_s is not None:
        gain_mps2 = stops[max(now.stops_done - 1, 0)].acceleration_mps2
        speed_mps = min(speed_mps, gain_mps2 * (time_s - now.released_s))
    if now.stops_done < len(stops):
        speed_mps = min(speed_mps, braking_speed(stops[now.stops_done], s_m))
    return speed_mps


def braking_speed(stop: Stop, s_m: float) -> float:
    """The speed in m/s at `s_m` from which the deceleration of a stop ends at its target."""
    return sqrt(2.0 * stop.deceleration_mps2 * max(stop.at_s_m - s_m, 0.0))
