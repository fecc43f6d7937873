"""Manoeuvres as data: a road, a speed, and where the car should be on the road.

A scenario file is TOML; the ones that ship lie in `scenarios/`. Lateral moves are minimum-jerk:
a fifth-order polynomial in arc length, at rest at both ends.
"""

import tomllib
from dataclasses import dataclass
from importlib import resources
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S

PREVIEW_S = 0.6
"""how far ahead the polynomial on the bus has to hold: the controller's horizon and some"""
PREVIEW_MIN_M = 4.0
MAX_SLOPE = 0.5
"""of the path against the road: what the frames can carry, with some room for the fit"""
STEEPEST_MIN_JERK = 1.875
"""peak slope of a minimum-jerk move, in units of height over length"""
GRAVITY_MPS2 = 9.81
_KMH_PER_MPS = 3.6


@dataclass(frozen=True, slots=True)
class LateralMove:
    """From wherever the path is to `to_m`, beginning at arc length `start_m`."""

    start_m: float
    length_m: float
    to_m: float


@dataclass(frozen=True, slots=True)
class Scenario:
    """One manoeuvre on a road of constant curvature at a constant wanted speed."""

    name: str
    speed_mps: float
    curvature_per_m: float
    duration_s: float
    road_friction: float
    moves: tuple[LateralMove, ...]

    @property
    def ticks(self) -> int:
        return ceil(self.duration_s / PERIOD_S - 1e-9)

    def lateral_m(self, s_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The wanted lateral deviation at arc lengths `s_m`, same shape."""
        lateral = np.zeros_like(s_m)
        offset_m = 0.0
        for move in self.moves:
            t = np.clip((s_m - move.start_m) / move.length_m, 0.0, 1.0)
            lateral = lateral + (move.to_m - offset_m) * t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
            offset_m = move.to_m
        return lateral

    def path_ahead(self, s_m: float, vx_mps: float) -> PathReference:
        """The cubic that a path planner would send from arc length `s_m`.

        It is exact at the car and fits the path ahead by least squares.
        """
        reach_m = max(PREVIEW_S * max(vx_mps, self.speed_mps), PREVIEW_MIN_M)
        unit = _PREVIEW_NODES
        here_m = float(self.lateral_m(np.array([s_m]))[0])
        ahead_m = self.lateral_m(s_m + reach_m * unit) - here_m
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
        """The lateral acceleration that the manoeuvre asks for at its wanted speed."""
        s_m = np.linspace(0.0, self.speed_mps * self.duration_s, 4000)
        bend = np.gradient(np.gradient(self.lateral_m(s_m), s_m), s_m)
        return float(np.max(np.abs(bend + self.curvature_per_m)) * self.speed_mps**2)


_PREVIEW_NODES = np.linspace(0.0, 1.0, 13)[1:]
_CUBIC_THROUGH_ORIGIN = np.linalg.pinv(np.stack([_PREVIEW_NODES**k for k in (1, 2, 3)], axis=1))


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("sim_bridge") / "scenarios"
    return sorted(
        f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")
    )


def load_scenario(name_or_path: str) -> Scenario:
    """A shipped scenario by name, or one from a TOML file.

    Raises:
        ConfigError: there is none of that name, or a field is missing, unknown or makes no sense.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"{path}: expected a scenario file, found nothing readable ({error.strerror})."
            ) from error
    elif name_or_path in shipped_scenarios():
        file = resources.files("sim_bridge") / "scenarios" / f"{name_or_path}.toml"
        text = file.read_text(encoding="utf-8")
    else:
        raise ConfigError(
            f"scenario {name_or_path!r}: expected one of {', '.join(shipped_scenarios())} or the "
            f"path of a .toml file."
        )
    try:
        return _parse(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"scenario {name_or_path}: {_explain(error)}") from error


_FIELDS = {"name", "speed_kmh", "curvature_per_m", "duration_s", "road_friction", "moves"}
_MOVE_FIELDS = {"start_m", "length_m", "to_m"}


def _parse(raw: dict[str, Any]) -> Scenario:
    _require_fields(raw, _FIELDS, "the scenario")
    for move in raw["moves"]:
        _require_fields(move, _MOVE_FIELDS, "a move")
    scenario = Scenario(
        name=str(raw["name"]),
        speed_mps=float(raw["speed_kmh"]) / _KMH_PER_MPS,
        curvature_per_m=float(raw["curvature_per_m"]),
        duration_s=float(raw["duration_s"]),
        road_friction=float(raw["road_friction"]),
        moves=tuple(LateralMove(**{k: float(v) for k, v in move.items()}) for move in raw["moves"]),
    )
    _require(scenario.speed_mps >= 0.0, "speed_kmh", ">= 0", raw["speed_kmh"])
    _require(scenario.duration_s > 0.0, "duration_s", "> 0", raw["duration_s"])
    _require(
        abs(scenario.curvature_per_m) <= 0.02,
        "curvature_per_m",
        "within ±0.02",
        raw["curvature_per_m"],
    )
    _require(
        0.05 <= scenario.road_friction <= 1.5, "road_friction", "0.05..1.5", raw["road_friction"]
    )
    end_m = -np.inf
    offset_m = 0.0
    for move in scenario.moves:
        _require(move.length_m > 0.0, "moves.length_m", "> 0", move.length_m)
        _require(
            move.start_m >= end_m,
            "moves.start_m",
            f">= {end_m} (moves must not overlap)",
            move.start_m,
        )
        steepest = STEEPEST_MIN_JERK * abs(move.to_m - offset_m) / move.length_m
        _require(steepest <= MAX_SLOPE, "moves.to_m", f"a slope up to {MAX_SLOPE}", steepest)
        end_m = move.start_m + move.length_m
        offset_m = move.to_m
    grip_mps2 = scenario.road_friction * GRAVITY_MPS2
    peak = scenario.peak_lateral_mps2()
    _require(peak < grip_mps2, "moves", f"less than the grip of {grip_mps2:.1f} m/s^2", peak)
    return scenario


def _require_fields(raw: dict[str, Any], fields: set[str], where: str) -> None:
    if set(raw) != fields:
        raise ValueError(
            f"expected the fields {sorted(fields)} in {where}, missing "
            f"{sorted(fields - set(raw))}, unknown {sorted(set(raw) - fields)}"
        )


def _require(holds: bool, field: str, expected: str, found: object) -> None:
    if not holds:
        raise ValueError(f"{field}: expected {expected}, found {found}")


def _explain(error: Exception) -> str:
    return f"missing field {error}" if isinstance(error, KeyError) else str(error)
