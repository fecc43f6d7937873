"""Scenario files of format 1: one curvature, one speed, one friction, and lateral moves."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from sim_bridge.scenario.lateral import Move, Moves
from sim_bridge.scenario.limits import FASTEST_KMH, KMH_PER_MPS, SLOWEST_KMH
from sim_bridge.scenario.road import Road
from sim_bridge.scenario.scenario import Scenario, Start
from sim_bridge.scenario.speed import constant_speed
from sim_bridge.scenario.table import constant

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class Format1Move(BaseModel):
    """A move from the present lateral position to `to_m`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start_m: _Finite
    """arc length at which the move begins"""
    length_m: Annotated[_Finite, Field(gt=0)]
    to_m: _Finite


def _driving_speed(speed_kmh: float) -> float:
    if not SLOWEST_KMH <= speed_kmh <= FASTEST_KMH:
        raise ValueError(
            f"expected at least {SLOWEST_KMH:g} and at most {FASTEST_KMH:g} km/h, found "
            f"{speed_kmh:g}. A car that stands is described with format = 2"
        )
    return speed_kmh


class Format1(BaseModel):
    """A manoeuvre on a road of constant curvature at a constant wanted speed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Annotated[int, Field(ge=1, le=1)] = 1
    name: str
    speed_kmh: Annotated[float, AfterValidator(_driving_speed)]
    curvature_per_m: Annotated[float, Field(ge=-0.02, le=0.02)]
    duration_s: Annotated[_Finite, Field(gt=0)]
    road_friction: Annotated[float, Field(ge=LEAST_FRICTION, le=MOST_FRICTION)]
    """1 is the road of the tyre test"""
    moves: tuple[Format1Move, ...]

    def scenario(self, folder: Path) -> Scenario:
        """The same drive as a scenario; `folder` is not used: the file names no other files."""
        speed_mps = self.speed_kmh / KMH_PER_MPS
        return Scenario(
            name=self.name,
            duration_s=self.duration_s,
            start=Start(speed_mps),
            road=Road(
                curvature_per_m=constant(self.curvature_per_m),
                friction_left=constant(self.road_friction),
                friction_right=constant(self.road_friction),
            ),
            speed=constant_speed(speed_mps),
            lateral=Moves(tuple(Move(m.start_m, m.length_m, m.to_m) for m in self.moves)),
        )
