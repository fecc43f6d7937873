"""`Scenario`: a road, what is wanted along it, and by which figures the drive is judged."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import ceil, inf, nan, radians
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from rt_controller.contract.arrays import Array
from rt_controller.contract.preview import REACH_S, fit_preview
from rt_controller.contract.signals import CurvaturePreview, PathReference
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.fault import Fault
from sim_bridge.plant.parts import NO_PAYLOAD, Payload
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario.lanes import Course
from sim_bridge.scenario.lateral import Lateral, LateralTable
from sim_bridge.scenario.limits import (
    FASTEST_KMH,
    KMH_PER_MPS,
    LARGEST_START_EPSI_DEG,
    LARGEST_START_EY_M,
)
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.speed import (
    STANDING_MPS,
    START,
    Progress,
    SpeedProfile,
    Stop,
    reference_speed,
)
from sim_bridge.scenario.table import Table, constant
from sim_bridge.scenario.values import NotNegative
from sim_bridge.toml_file import FileTable, Number

PREVIEW_MIN_M = 4.0
_CURVATURE_SAMPLES = 33
_PREVIEW_NODES = np.linspace(0.0, 1.0, 13)[1:]
_PREVIEW_TIMES_S = (REACH_S * _PREVIEW_NODES).tolist()
_NODE_WEIGHTS = (_PREVIEW_NODES + 0.05) ** -2.0
"""of the fit: what is near is driven first, and by what is far the path is fitted again"""
_CUBIC_THROUGH_ORIGIN = _NODE_WEIGHTS * np.linalg.pinv(
    _NODE_WEIGHTS[:, None] * np.stack([_PREVIEW_NODES**k for k in (1, 2, 3)], axis=1)
)
_SLOWEST_MPS = 1.0
"""lower limit of the speed that converts distances ahead to times"""


class Start(FileTable):
    """`[initial]`: the car when the drive begins, settled and driving straight ahead."""

    speed_mps: Annotated[
        Number,
        Field(alias="speed_kmh", ge=0.0, le=FASTEST_KMH),
        AfterValidator(lambda kmh: kmh / KMH_PER_MPS),
    ] = nan
    """NaN in a file: the wanted speed"""
    s_m: NotNegative = 0.0
    ey_m: Annotated[Number, Field(ge=-LARGEST_START_EY_M, le=LARGEST_START_EY_M)] = 0.0
    epsi_rad: Annotated[
        Number,
        Field(alias="epsi_deg", ge=-LARGEST_START_EPSI_DEG, le=LARGEST_START_EPSI_DEG),
        AfterValidator(radians),
    ] = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A drive as data; `load_scenario` reads one from a file."""

    name: str
    duration_s: float
    """the drive is over after this time at the latest"""
    start: Start
    road: Road
    speed: SpeedProfile
    lateral: Lateral = field(default_factory=lambda: LateralTable(constant(0.0)))
    stops: tuple[Stop, ...] = ()
    cross_wind_mps: Table = field(default_factory=lambda: constant(0.0))
    """across the road over time, positive towards the left"""
    tail_wind_mps: Table = field(default_factory=lambda: constant(0.0))
    """along the road over time, positive: from behind"""
    distance_m: float = inf
    """the drive is over when the car has come so far"""
    payload: Payload = NO_PAYLOAD
    course: Course = field(default_factory=Course)
    """cones and lanes, and the body that has to pass between them"""
    faults: tuple[Fault, ...] = ()
    metrics: tuple[str, ...] = ()
    """names of the figures that the drive is judged by; empty: those with a limit"""
    limits: Mapping[str, float] = field(default_factory=dict)
    """the worst value of a figure with which a drive passes"""

    @property
    def ticks(self) -> int:
        """Control periods of the drive, if it is not over before."""
        return ceil(self.duration_s / PERIOD_S - 1e-9)

    @property
    def end_m(self) -> float:
        """Arc length at which the drive is over."""
        return min(self.start.s_m + self.distance_m, self.road.length_m)

    @property
    def first_progress(self) -> Progress:
        """The progress at the start: a drive with stops that begins at rest begins as after one."""
        is_at_rest = bool(self.stops) and self.start.speed_mps < STANDING_MPS
        return Progress(released_s=0.0) if is_at_rest else START

    def road_at(self, s_m: float, time_s: float) -> RoadAt:
        """Ground and air for a car that is parallel to the road."""
        return self.road.at(s_m, self.tail_wind_mps.at(time_s), self.cross_wind_mps.at(time_s))

    def ey_m(self, s_m: Array, time_s: Array | float = 0.0) -> Array:
        """The wanted lateral deviation at arc lengths `s_m` reached at `time_s`, same shape."""
        return self.lateral.ey_m(s_m, np.broadcast_to(time_s, s_m.shape))

    def reference_speed_mps(
        self, s_m: float, time_s: float, progress: Progress | None = None
    ) -> float:
        """The wanted speed of a car at `s_m`; `progress` None: before the first stop."""
        progress = progress or self.first_progress
        return reference_speed(self.speed, self.stops, progress, s_m, time_s)

    def path_ahead(
        self, s_m: float, vx_mps: float, time_s: float = 0.0, progress: Progress | None = None
    ) -> PathReference:
        """The cubic and the speed that a path planner would send for a car at `s_m`.

        Both are exact at the car and least-squares fits of what follows.

        Args:
            s_m: arc length.
            vx_mps: speed of the car.
            time_s: since the car was first driven.
            progress: with the stops; None: before the first.
        """
        progress = progress or self.first_progress
        speed_mps = self.reference_speed_mps(s_m, time_s, progress)
        here = (np.array([value]) for value in (s_m, time_s, vx_mps, speed_mps))
        c0_m, c1, c2_per_m, c3_per_m2 = self.cubics_ahead(*here)[0].tolist()
        return PathReference(
            c0_m=c0_m,
            c1=c1,
            c2_per_m=c2_per_m,
            c3_per_m2=c3_per_m2,
            v_mps=speed_mps,
            a_mps2=self._acceleration_ahead(speed_mps, s_m, time_s, progress),
        )

    def cubics_ahead(self, s_m: Array, time_s: Array, vx_mps: Array, wanted_mps: Array) -> Array:
        """(n, 4) coefficients of the path over the distance ahead, ascending.

        Args:
            s_m: (n,) arc lengths.
            time_s: (n,) at which they are reached.
            vx_mps: (n,) speed of the car.
            wanted_mps: (n,) its wanted speed.
        """
        reach_m = np.maximum(REACH_S * np.maximum(vx_mps, wanted_mps), PREVIEW_MIN_M)[:, None]
        mean_mps = np.maximum(0.5 * (vx_mps + wanted_mps), _SLOWEST_MPS)[:, None]
        here_m = self.ey_m(s_m, time_s)[:, None]
        ahead = reach_m * _PREVIEW_NODES
        ahead_m = self.ey_m(s_m[:, None] + ahead, time_s[:, None] + ahead / mean_mps) - here_m
        scaled = ahead_m @ _CUBIC_THROUGH_ORIGIN.T
        return np.hstack((here_m, scaled / reach_m ** np.array([1, 2, 3])))

    def preview_ahead(self, s_m: float, vx_mps: float, wanted_mps: float) -> CurvaturePreview:
        """The curvature of the road that a path planner would send for a car at `s_m`.

        It reaches as far as `path_ahead`.

        Args:
            s_m: arc length.
            vx_mps: speed of the car.
            wanted_mps: its wanted speed.
        """
        reach_m = _reach_m(vx_mps, wanted_mps)
        return fit_preview(self.road.curvature_ahead(s_m, reach_m, _CURVATURE_SAMPLES), reach_m)

    def with_friction(self, friction: float | None, right: float | None = None) -> "Scenario":
        """The same drive with the same friction everywhere; None: that of its own road.

        `friction` holds on both sides, or on the left one if `right` is given.
        """
        if friction is None and right is None:
            return self
        road = self.road
        if friction is not None:
            both = constant(friction)
            road = road.model_copy(update={"friction_left": both, "friction_right": both})
        if right is not None:
            road = road.model_copy(update={"friction_right": constant(right)})
        return replace(self, road=road)

    def _acceleration_ahead(
        self, speed_mps: float, s_m: float, time_s: float, progress: Progress
    ) -> float:
        """Slope of the wanted speed over the preview; where it reaches zero, up to there."""
        if self.speed.is_constant and progress.released_s is None and not self.stops:
            return 0.0
        if progress.is_holding:
            return 0.0
        product = square = before_s = 0.0
        now_mps = speed_mps
        for t in _PREVIEW_TIMES_S:
            s_m += now_mps * (t - before_s)
            now_mps = self.reference_speed_mps(s_m, time_s + t, progress)
            product += t * (now_mps - speed_mps)
            square += t * t
            before_s = t
            if now_mps == 0.0 and speed_mps > 0.0:
                break
        return product / square


def _reach_m(vx_mps: float, wanted_mps: float) -> float:
    return max(REACH_S * max(vx_mps, wanted_mps), PREVIEW_MIN_M)
