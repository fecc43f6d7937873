"""Scenarios: a road, a wanted speed, and the wanted lateral position along the road.

A scenario file is TOML; the shipped ones are in `scenarios/`. Lateral moves are minimum-jerk
polynomials of fifth order in arc length, with zero slope and curvature at both ends.
"""

from math import ceil, inf
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.toml_file import parse, read_shipped_or_own, shipped_names

PREVIEW_S = 0.6
"""time for which the polynomial on the bus has to fit: longer than the controller's horizon"""
PREVIEW_MIN_M = 4.0
MAX_SLOPE = 0.5
"""of the path against the road; limited by the value range of the frames, with a margin"""
STEEPEST_MIN_JERK = 1.875
"""peak slope of a minimum-jerk move, in units of height over length"""
_KMH_PER_MPS = 3.6
_FASTEST_KMH = 250.0
_SCENARIOS_FOLDER = "scenarios"
_PREVIEW_NODES = np.linspace(0.0, 1.0, 13)[1:]
_CUBIC_THROUGH_ORIGIN = np.linalg.pinv(np.stack([_PREVIEW_NODES**k for k in (1, 2, 3)], axis=1))

_Finite = Annotated[float, Field(allow_inf_nan=False)]


class LateralMove(BaseModel):
    """A move from the present lateral position to `to_m`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start_m: _Finite
    """arc length at which the move begins"""
    length_m: Annotated[_Finite, Field(gt=0)]
    to_m: _Finite


class Scenario(BaseModel):
    """A manoeuvre on a road of constant curvature at a constant wanted speed."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    speed_kmh: Annotated[float, Field(gt=0, le=_FASTEST_KMH)]
    curvature_per_m: Annotated[float, Field(ge=-0.02, le=0.02)]
    duration_s: Annotated[_Finite, Field(gt=0)]
    road_friction: Annotated[float, Field(ge=LEAST_FRICTION, le=MOST_FRICTION)]
    """1 is the road of the tyre test"""
    moves: tuple[LateralMove, ...]

    @property
    def speed_mps(self) -> float:
        """The wanted speed."""
        return self.speed_kmh / _KMH_PER_MPS

    @property
    def ticks(self) -> int:
        """Control periods of the manoeuvre."""
        return ceil(self.duration_s / PERIOD_S - 1e-9)

    def lateral_m(self, s_m: Array) -> Array:
        """The wanted lateral deviation at arc lengths `s_m`, same shape."""
        lateral = np.zeros_like(s_m)
        offset_m = 0.0
        for move in self.moves:
            t = np.clip((s_m - move.start_m) / move.length_m, 0.0, 1.0)
            lateral = lateral + (move.to_m - offset_m) * t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
            offset_m = move.to_m
        return lateral

    def path_ahead(self, s_m: float, vx_mps: float) -> PathReference:
        """The cubic that a path planner would send at arc length `s_m`.

        It is exact at the car and a least-squares fit of the path ahead.
        """
        reach_m = max(PREVIEW_S * max(vx_mps, self.speed_mps), PREVIEW_MIN_M)
        here_m = float(self.lateral_m(np.array([s_m]))[0])
        ahead_m = self.lateral_m(s_m + reach_m * _PREVIEW_NODES) - here_m
        c1, c2, c3 = _CUBIC_THROUGH_ORIGIN @ ahead_m
        return PathReference(
            c0_m=here_m,
            c1=c1 / reach_m,
            c2_per_m=c2 / reach_m**2,
            c3_per_m2=c3 / reach_m**3,
            v_mps=self.speed_mps,
            a_mps2=0.0,
        )

    def peak_lateral_mps2(self) -> float:
        """The largest lateral acceleration of the manoeuvre at its wanted speed."""
        s_m = np.linspace(0.0, self.speed_mps * self.duration_s, 4000)
        bend = np.gradient(np.gradient(self.lateral_m(s_m), s_m), s_m)
        return float(np.max(np.abs(bend + self.curvature_per_m)) * self.speed_mps**2)

    @model_validator(mode="after")
    def _require_drivable(self) -> Self:
        problems = []
        end_m, offset_m = -inf, 0.0
        for i, move in enumerate(self.moves):
            if move.start_m < end_m:
                problems.append(
                    f"moves[{i}].start_m: expected at least {end_m:g} (moves must not overlap), "
                    f"found {move.start_m:g}."
                )
            steepest = STEEPEST_MIN_JERK * abs(move.to_m - offset_m) / move.length_m
            if steepest > MAX_SLOPE:
                problems.append(
                    f"moves[{i}].to_m: expected a slope of at most {MAX_SLOPE}, found "
                    f"{steepest:.2f}. Increase length_m."
                )
            end_m = move.start_m + move.length_m
            offset_m = move.to_m
        if not problems:
            grip_mps2 = self.road_friction * GRAVITY_MPS2
            peak_mps2 = self.peak_lateral_mps2()
            if peak_mps2 >= grip_mps2:
                problems = [
                    f"moves: expected a lateral acceleration below the grip of {grip_mps2:.1f} "
                    f"m/s^2, found {peak_mps2:.1f} m/s^2. Lower speed_kmh or lengthen the moves."
                ]
        if problems:
            raise ValueError("\n".join(problems))
        return self


_SCHEMA = TypeAdapter(Scenario)


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    return shipped_names(_SCENARIOS_FOLDER)


def load_scenario(name_or_path: str) -> Scenario:
    """A shipped scenario by name, or one from a TOML file.

    Raises:
        ConfigError: there is no such scenario, or fields are missing, unknown or out of their
            limits. The message names all such fields.
    """
    text = read_shipped_or_own(name_or_path, _SCENARIOS_FOLDER, "scenario")
    return parse(text, _SCHEMA, f"scenario {name_or_path}")
