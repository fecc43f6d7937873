"""The wanted speed: a profile over distance or time, its kinds, and stops with a hold."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, sqrt
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from sim_bridge.scenario.limits import FASTEST_KMH, KMH_PER_MPS, SLOWEST_KMH
from sim_bridge.scenario.table import Table, constant, through
from sim_bridge.scenario.values import NotNegative, OverDistance, OverTime, Written, require_within
from sim_bridge.toml_file import FileTable, Number

STANDING_MPS = 0.1
"""a car below this speed counts as standing at its stop"""
STOP_WINDOW_M = 0.5
"""a car that stands at most so far from its target has stopped there"""
_CURVE_GRID_M = 1.0
_Cruise = Annotated[Number, Field(ge=SLOWEST_KMH, le=FASTEST_KMH)]
_Acceleration = Annotated[Number, Field(ge=0.1, le=12.0)]


class Stop(FileTable):
    """`[[stops]]`: brake to rest at a place, hold, drive on."""

    at_s_m: NotNegative
    """target"""
    hold_s: NotNegative = inf
    """without: to the end of the drive"""
    deceleration_mps2: _Acceleration = 2.5
    acceleration_mps2: _Acceleration = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class SpeedProfile:
    """A wanted speed over arc length or over time, with constant acceleration between its knots."""

    table: Table
    """speed in m/s over time, or its square over distance: both are linear between knots"""
    is_over_distance: bool = False
    stops: tuple[Stop, ...] = ()
    """that come with it"""

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


def speed_over_distance(
    s_m: Sequence[float], mps: Sequence[float], stops: tuple[Stop, ...] = ()
) -> SpeedProfile:
    """The profile through knots over arc length, with constant acceleration between them."""
    return SpeedProfile(through(s_m, [v * v for v in mps]), True, stops)


class CurveSpeed(FileTable):
    """The speed that curvature, acceleration and deceleration allow."""

    kind: Literal["curve_speed"]
    max_kmh: _Cruise
    lateral_mps2: _Acceleration = 3.0
    acceleration_mps2: _Acceleration = 1.5
    deceleration_mps2: _Acceleration = 2.5

    def profile(
        self, curvature: Table, end_m: float, fastest_mps: Table | None = None
    ) -> SpeedProfile:
        """The fastest speed within its limits: first by curvature, then backwards, then forwards.

        Args:
            curvature: of the road in 1/m.
            end_m: arc length up to which it is computed.
            fastest_mps: speed limit along the road; None: `max_kmh`.
        """
        grid_m = _CURVE_GRID_M
        fastest = fastest_mps or constant(self.max_kmh / KMH_PER_MPS)
        s_m = np.arange(0.0, end_m + grid_m, grid_m)
        bends = [np.abs(curvature(s_m + shift)) for shift in (-grid_m, 0, grid_m)]
        around = np.maximum(np.maximum.reduce(bends), 1e-9)
        squared = np.minimum(fastest(s_m) ** 2, self.lateral_mps2 / around)
        gain = 2.0 * grid_m * self.acceleration_mps2
        loss = 2.0 * grid_m * self.deceleration_mps2
        for i in range(len(s_m) - 2, -1, -1):
            squared[i] = min(squared[i], squared[i + 1] + loss)
        for i in range(1, len(s_m)):
            squared[i] = min(squared[i], squared[i - 1] + gain)
        return speed_over_distance(s_m.tolist(), np.sqrt(squared).tolist())


Speed = SpeedProfile | CurveSpeed


def _to_speed(found: Any) -> Speed:
    """The speed that a file gives in km/h."""
    if isinstance(found, Speed):
        return found
    if isinstance(found, int | float):
        require_within(constant(found), 0.0, FASTEST_KMH, "km/h")
        if 0.0 < found < SLOWEST_KMH:
            raise ValueError(f"expected 0 or at least {SLOWEST_KMH:g} km/h, found {found:g}")
        return constant_speed(found / KMH_PER_MPS)
    if isinstance(found, OverTime):
        require_within(found.table(), 0.0, FASTEST_KMH, "km/h")
        return SpeedProfile(found.table().scaled(1.0 / KMH_PER_MPS))
    if "interpolation" in found.model_fields_set:
        raise ValueError(
            "interpolation: expected none for a speed over s_m, whose acceleration is constant "
            f"between the knots, found {found.interpolation.value!r}"
        )
    require_within(found.table(), 0.0, FASTEST_KMH, "km/h")
    if any(a == 0.0 and b > 0.0 for a, b in pairwise(found.value)):
        raise ValueError(
            "value: expected a speed above 0 after a speed of 0, or 0 up to the end; a speed "
            "over s_m cannot leave a standstill, found one. Use [[stops]] with hold_s, or t_s"
        )
    mps = [v / KMH_PER_MPS for v in found.value]
    return speed_over_distance(found.s_m, mps, _stop_at_end(found.s_m, mps))


def _stop_at_end(s_m: Sequence[float], mps: Sequence[float]) -> tuple[Stop, ...]:
    """The stop of a profile that ends with a speed of 0."""
    if mps[-1] > 0.0 or mps[0] == 0.0:
        return ()
    k = mps.index(0.0)
    # With the steepest way down from any knot the stop never lies below the profile before it.
    steepest = max(v * v / (2.0 * (s_m[k] - s)) for s, v in zip(s_m[:k], mps[:k], strict=True))
    return (Stop.model_construct(at_s_m=s_m[k], deceleration_mps2=steepest),)


WantedSpeed = Annotated[
    Speed,
    Written(
        {"s_m": OverDistance, "t_s": OverTime, "curve_speed": CurveSpeed},
        _to_speed,
        f"0, {SLOWEST_KMH:g}..{FASTEST_KMH:g}",
    ),
]


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
