"""The faults of the matrix, and the drives in which they act."""

import tomllib
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.names import hint
from sim_bridge.fault_matrix.manoeuvres import LANE_CHANGE, MANOEUVRES, manoeuvre
from sim_bridge.scenario import Scenario, parse_scenario
from sim_bridge.scenario.limits import KMH_PER_MPS

SPEEDS_KMH = (60.0, 80.0, 120.0)
FAULT_START_S = 2.0
"""the steering wheel is turned: the lane change begins at 1 s and takes 2.5 s"""


@dataclass(frozen=True, slots=True)
class Case:
    """One fault, or several that act together, under a name."""

    name: str
    faults: tuple[dict[str, Any], ...]
    """as in a file"""
    initial: dict[str, float]
    """of the scenario"""
    known_limit: str = ""
    """why no reaction keeps the car on its lane; its drives are judged like all others"""
    manoeuvre: str = LANE_CHANGE
    """one of `MANOEUVRES`"""
    condition: str = ""
    """name of the one in `conditions.toml`; "": none"""
    payload: dict[str, float] = field(default_factory=dict)
    """of the scenario"""
    sensors: tuple[dict[str, Any], ...] = ()
    """what the sensors do beside the fault, as in a file: noise"""

    @property
    def is_fault_free(self) -> bool:
        """True of the drive without a fault, which nothing may report."""
        return not self.faults and not self.initial

    def scenario(self, speed_kmh: float) -> Scenario:
        """The drive of this case, with the faults."""
        speed_mps = speed_kmh / KMH_PER_MPS
        drive = manoeuvre(self.manoeuvre, speed_mps)
        content = {
            "format": 2,
            "name": f"{self.name} at {speed_kmh:g} km/h",
            "reference": {"speed_kmh": speed_kmh, "ey_m": drive.pop("ey_m", 0.0)},
            "initial": self.initial,
            **drive,
            "faults": [
                *({"start_s": FAULT_START_S, **fault} for fault in self.faults),
                *({"start_s": 0.0, "before_drive": True, **fault} for fault in self.sensors),
            ],
        }
        if self.payload:
            content["payload"] = self.payload
        return parse_scenario(content, f"fault {self.name}")

    def under(self, condition: str) -> "Case":
        """This case under a condition of `conditions.toml`.

        Raises:
            ConfigError: there is no such condition.
        """
        conditions = _shipped("conditions.toml")
        if condition not in conditions:
            raise ConfigError(
                f"--conditions: expected some of {', '.join(conditions)}, found {condition!r}"
                f"{hint(condition, conditions)}."
            )
        return replace(self, condition=condition, **_fields_of(conditions[condition]))


def _fields_of(condition: dict[str, Any]) -> dict[str, Any]:
    return {**condition, "sensors": tuple(condition.get("sensors", ()))}


def whole_matrix() -> tuple[Case, ...]:
    """The cases of `cases.toml` as they are, and those of `drifts.toml` under each condition."""
    drifts = _cases_in(_shipped("drifts.toml"), "drifts.toml")
    crossed = (case.under(name) for name in _shipped("conditions.toml") for case in drifts)
    return (*load_cases(), *crossed)


@cache
def _shipped(name: str) -> dict[str, Any]:
    text = (resources.files("sim_bridge.fault_matrix") / name).read_text("utf-8")
    return tomllib.loads(text)


def load_cases(file: Path | None = None) -> tuple[Case, ...]:
    """All cases of a file in its order; None: of `cases.toml`.

    Raises:
        ConfigError: the file cannot be read, or its content is not one of cases.
    """
    if file is None:
        return _cases_in(_shipped("cases.toml"), "cases.toml")
    try:
        content = tomllib.loads(read_text(file))
    except (OSError, ValueError, RecursionError) as error:  # also a number without end
        raise ConfigError(
            f"--cases {file}: expected a TOML file with a table for each fault, found {error}. "
            f"docs/faults.md has an example."
        ) from error
    return _cases_in(content, str(file))


def _cases_in(content: dict[str, Any], source: str) -> tuple[Case, ...]:
    cases = []
    for name, case in content.items():
        if not isinstance(case, dict) or not isinstance(case.get("faults"), list):
            raise ConfigError(
                f"{source}: {name}: expected a table with the list faults, found {case!r}. "
                f"docs/faults.md has an example."
            )
        drive = case.get("manoeuvre", LANE_CHANGE)
        if drive not in MANOEUVRES:
            raise ConfigError(
                f"{source}: {name}.manoeuvre: expected one of {', '.join(MANOEUVRES)}, found "
                f"{drive!r}{hint(str(drive), MANOEUVRES)}."
            )
        limit, initial = case.get("known_limit", ""), case.get("initial", {})
        cases.append(Case(name, tuple(case["faults"]), initial, limit, drive))
    if not cases:
        raise ConfigError(
            f"{source}: expected a table with the list faults for each fault, found none. "
            f"docs/faults.md has an example."
        )
    return tuple(cases)
