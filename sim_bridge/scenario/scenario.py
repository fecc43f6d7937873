"""`Scenario`: a road, what is wanted along it, and how the drive is judged."""

from dataclasses import replace
from functools import cached_property
from math import ceil, inf, isnan, nan, radians
from operator import attrgetter
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, field_validator, model_validator
from pydantic.dataclasses import dataclass

from rt_controller.contract.arrays import Array
from rt_controller.contract.preview import INTERVALS, LARGEST_PER_M, REACH_S, fit_preview
from rt_controller.contract.signals import CurvaturePreview, PathReference
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.fault import Faults
from sim_bridge.faults.names import name_in
from sim_bridge.plant.parts import NO_PAYLOAD
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.scenario.courses import Body, Course, IsoLaneChange, Slalom
from sim_bridge.scenario.lateral import Lateral, Moves, Sine, to_lateral
from sim_bridge.scenario.limits import (
    FASTEST_KMH,
    KMH_PER_MPS,
    LARGEST_EY_M,
    LARGEST_START_EPSI_DEG,
    LARGEST_START_EY_M,
    LONGEST_S,
    STRONGEST_WIND_MPS,
)
from sim_bridge.scenario.metrics import HIGHER_IS_BETTER, Metrics
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.speed import (
    STANDING_MPS,
    START,
    Progress,
    SpeedProfile,
    Stop,
    WantedSpeed,
    reference_speed,
)
from sim_bridge.scenario.table import Table, constant
from sim_bridge.scenario.values import NotNegative, OverDistance, OverTime, Written, table_within
from sim_bridge.toml_file import FileTable, Number, entries

PREVIEW_MIN_M = 4.0
_CURVATURE_AT = np.linspace(0.0, 1.0, 33)
_PREVIEW_NODES = np.linspace(0.0, 1.0, 13)[1:]
_PREVIEW_TIMES_S = (REACH_S * _PREVIEW_NODES).tolist()
_NODE_WEIGHTS = (_PREVIEW_NODES + 0.05) ** -2.0
"""of the fit: what is near is driven first, and by what is far the path is fitted again"""
_POWERS = _PREVIEW_NODES[:, None] ** [1, 2, 3]
_CUBIC_THROUGH_ORIGIN = _NODE_WEIGHTS * np.linalg.pinv(_NODE_WEIGHTS[:, None] * _POWERS)
_CUBES = np.maximum(_PREVIEW_NODES[:, None] - np.arange(INTERVALS + 2) / INTERVALS, 0.0) ** 3
_BENDS = INTERVALS / 6.0 * np.diff(_CUBES, 2)
"""(nodes, 4) places by a unit of each of K1 to K4: the lines between them, integrated twice"""
_BEND_PENALTY = 0.01
"""of a curvature times the reach squared, beside the weights: no larger bends than needed"""
_BENDS_TO_FIT = np.vstack((_NODE_WEIGHTS[:, None] * _BENDS, _BEND_PENALTY * np.eye(INTERVALS)))
_BENDS_OF_REST = (np.linalg.pinv(_BENDS_TO_FIT)[:, : len(_POWERS)] * _NODE_WEIGHTS) @ (
    np.eye(len(_POWERS)) - _POWERS @ _CUBIC_THROUGH_ORIGIN
)
_THROUGH_ORIGIN = np.vstack((_CUBIC_THROUGH_ORIGIN, _BENDS_OF_REST))
"""from places ahead to the cubic, and to curvatures that follow what it lacks"""
_SLOWEST_MPS = 1.0
"""lower limit of the speed that converts distances ahead to times"""


class Start(FileTable):
    """`[initial]`: the car when the drive begins, settled on the road where it begins."""

    speed_mps: Annotated[
        Number,
        Field(alias="speed_kmh", ge=0.0, le=FASTEST_KMH),
        AfterValidator(lambda kmh: kmh / KMH_PER_MPS),
    ] = nan
    """speed at the start, with engine, gear and tyres settled; without: the wanted speed"""
    s_m: NotNegative = 0.0
    """arc length"""
    ey_m: Annotated[Number, Field(ge=-LARGEST_START_EY_M, le=LARGEST_START_EY_M)] = 0.0
    """lateral position, positive to the left"""
    epsi_rad: Annotated[
        Number,
        Field(alias="epsi_deg", ge=-LARGEST_START_EPSI_DEG, le=LARGEST_START_EPSI_DEG),
        AfterValidator(radians),
    ] = 0.0
    """heading against the road"""


class Reference(FileTable):
    """`[reference]`: what the car is asked for."""

    speed_kmh: WantedSpeed
    ey_m: Annotated[
        Lateral | Slalom | IsoLaneChange,
        Written(
            {
                "s_m": OverDistance,
                "t_s": OverTime,
                "moves": Moves,
                "sine": Sine,
                "slalom": Slalom,
                "iso_3888_1": IsoLaneChange,
                "iso_3888_2": IsoLaneChange,
            },
            to_lateral,
            f"±{LARGEST_EY_M:g}",
        ),
    ] = Lateral(constant(0.0))


class Load(FileTable):
    """`[payload]`: a point mass in the car's plane of symmetry."""

    mass_kg: Annotated[Number, Field(ge=0.0, le=1000.0)] = 0.0
    ahead_m: Annotated[Number, Field(ge=-2.0, le=2.0)] = NO_PAYLOAD.ahead_m
    """of the centre of gravity of the car without it; negative: behind"""
    height_m: Annotated[Number, Field(ge=0.0, le=3.0)] = NO_PAYLOAD.height_m
    """above the ground"""


_MetricName = Annotated[str, name_in(Metrics._fields)]
_Wind = Annotated[
    Table, table_within(-STRONGEST_WIND_MPS, STRONGEST_WIND_MPS, "m/s", tables={"t_s": OverTime})
]


@dataclass(frozen=True, eq=False, kw_only=True, config=ConfigDict(extra="forbid"))
class Scenario:
    """A drive as data: what a scenario file of format 2 says, and what follows from it.

    `load_scenario` reads one from a file; `dataclasses.replace` checks the single values again.
    """

    format: Literal[2]
    """version of the file"""
    name: Annotated[str, Field(min_length=1)]
    """for messages"""
    duration_s: Annotated[Number, Field(gt=0.0, le=LONGEST_S)]
    """the drive is over after this time at the latest"""
    distance_m: Annotated[float, Field(gt=0.0, strict=True)] = inf
    """the drive is over when the car has come so far"""
    initial: Start = Start()
    road: Road = Field(default_factory=Road)
    reference: Reference
    stops: Annotated[tuple[Stop, ...], entries(0, 1000)] = ()
    cross_wind_mps: _Wind = constant(0.0)
    """speed of the air across the road, positive towards the left"""
    tail_wind_mps: _Wind = constant(0.0)
    """speed of the air along the road, positive: from behind"""
    payload: Load = Load()
    body: Body = Body()
    faults: Faults = ()
    metrics: tuple[_MetricName, ...] = ()
    """names of the figures that are reported; empty: those with a limit"""
    limits: dict[_MetricName, Number] = Field(default_factory=dict)
    """the worst value of each figure with which the drive passes"""

    @field_validator("limits")
    @classmethod
    def _require_reachable(cls, limits: dict[str, float]) -> dict[str, float]:
        for name, value in limits.items():
            if value < 0.0 and name not in HIGHER_IS_BETTER:
                raise ValueError(f"{name}: expected at least 0, found {value:g}")
        return limits

    @model_validator(mode="after")
    def _require_course(self) -> Self:
        _ = self._course_and_path
        return self

    @cached_property
    def start(self) -> Start:
        """The car at the beginning, with its speed."""
        start = self.initial
        if isnan(start.speed_mps):
            return start.model_copy(update={"speed_mps": self.speed.at(start.s_m, 0.0)})
        return start

    @cached_property
    def speed(self) -> SpeedProfile:
        """The wanted speed along the road, without the stops."""
        wanted = self.reference.speed_kmh
        if isinstance(wanted, SpeedProfile):
            return wanted
        fastest_m = self.initial.s_m + self.duration_s * FASTEST_KMH / KMH_PER_MPS
        return wanted.profile(self.road.curvature_per_m, min(self.end_m, fastest_m))

    @cached_property
    def all_stops(self) -> tuple[Stop, ...]:
        """The stops in their order, with that at the end of a speed over distance."""
        return tuple(sorted((*self.speed.stops, *self.stops), key=attrgetter("at_s_m")))

    @property
    def course(self) -> Course:
        """Cones and lanes, and the body that has to pass between them."""
        return self._course_and_path[0]

    @property
    def lateral(self) -> Lateral:
        """The wanted lateral deviation."""
        return self._course_and_path[1]

    @cached_property
    def _course_and_path(self) -> tuple[Course, Lateral]:
        path = self.reference.ey_m
        return (Course(self.body), path) if isinstance(path, Lateral) else path.driven_by(self.body)

    @property
    def ticks(self) -> int:
        """Control periods of the drive, if it is not over before."""
        return ceil(self.duration_s / PERIOD_S - 1e-9)

    @property
    def end_m(self) -> float:
        """Arc length at which the drive is over."""
        return min(self.initial.s_m + self.distance_m, self.road.length_m)

    @property
    def first_progress(self) -> Progress:
        """The progress at the start: a drive with stops that begins at rest begins as after one."""
        is_at_rest = bool(self.all_stops) and self.start.speed_mps < STANDING_MPS
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
        return reference_speed(self.speed, self.all_stops, progress, s_m, time_s)

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
        c0_m, c1, c2_per_m, c3_per_m2 = self.cubics_ahead(*here)[0, :4].tolist()
        return PathReference(
            c0_m=c0_m,
            c1=c1,
            c2_per_m=c2_per_m,
            c3_per_m2=c3_per_m2,
            v_mps=speed_mps,
            a_mps2=self._acceleration_ahead(speed_mps, s_m, time_s, progress),
        )

    def cubics_ahead(self, s_m: Array, time_s: Array, vx_mps: Array, wanted_mps: Array) -> Array:
        """(n, 8): the path ahead as a cubic, ascending, and curvatures that it lacks, as K1 to K4.

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
        scaled = ahead_m @ _THROUGH_ORIGIN.T
        return np.hstack((here_m, scaled / reach_m ** np.array([1, 2, 3, *[2] * INTERVALS])))

    def preview_ahead(
        self, s_m: float, vx_mps: float, wanted_mps: float, time_s: float = 0.0
    ) -> CurvaturePreview:
        """The curvature over the reach of `path_ahead`, as a path planner sends it.

        That of the road, and what the cubic lacks of the path.
        """
        reach_m = max(REACH_S * max(vx_mps, wanted_mps), PREVIEW_MIN_M)
        road = fit_preview(self.road.curvature_per_m(s_m + _CURVATURE_AT * reach_m), reach_m)
        here = (np.array([value]) for value in (s_m, time_s, vx_mps, wanted_mps))
        bends = np.clip(road[2:] + self.cubics_ahead(*here)[0, 4:], -LARGEST_PER_M, LARGEST_PER_M)
        return CurvaturePreview(*road[:2], *bends.tolist())

    def with_friction(self, friction: float | None, right: float | None = None) -> "Scenario":
        """The same drive with the same friction everywhere; None: that of its own road.

        `friction` holds on both sides, or on the left one if `right` is given.
        """
        sides = {"friction_left": friction, "friction_right": friction if right is None else right}
        update = {side: constant(found) for side, found in sides.items() if found is not None}
        return replace(self, road=self.road.model_copy(update=update)) if update else self

    def _acceleration_ahead(
        self, speed_mps: float, s_m: float, time_s: float, progress: Progress
    ) -> float:
        """Slope of the wanted speed over the preview; where it reaches zero, up to there."""
        if self.speed.is_constant and progress.released_s is None and not self.all_stops:
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
