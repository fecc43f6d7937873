"""The faults of the matrix, and the drives in which they act."""

import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter

from rt_controller.contract.files import read_text
from rt_controller.mapping.toml_file import parse, read_own
from sim_bridge.faults.names import name_in
from sim_bridge.scenario import Scenario, parse_scenario
from sim_bridge.scenario.limits import KMH_PER_MPS
from sim_bridge.toml_file import FileTable

SPEEDS_KMH = (60.0, 80.0, 120.0)
FAULT_START_S = 2.0  # the steering wheel is turned: the lane change begins at 1 s, takes 2.5 s
DURATION_S = 6.0  # of a drive; a stop that has begun before goes on until the car stands
SHARPEST_BEND_PER_M = 0.009
"""of the smallest radius that the wheel allows"""

Content = dict[str, Any]
"""of a scenario file, without what all drives have"""


def _lane_change(speed_mps: float, change_s: float = 2.5, friction: float = 0.85) -> Content:
    """3.5 m to the left and back, in a bend of 1000 m."""
    moves = [
        {"start_m": at_s * speed_mps, "length_m": change_s * speed_mps, "to_m": to_m}
        for at_s, to_m in ((1.0, 3.5), (4.5, 0.0))
    ]
    road = {"curvature_per_m": 0.001, "friction": friction}
    return {"road": road, "reference": {"ey_m": {"kind": "moves", "moves": moves}}}


def _bend(speed_mps: float) -> Content:
    """Through a clothoid into a bend of 4 m/s², or of the smallest radius of the wheel."""
    bend_per_m = min(4.0 / speed_mps**2, SHARPEST_BEND_PER_M)
    knots = [at_s * speed_mps for at_s in (1.0, 2.5)]
    return {"road": {"curvature_per_m": {"s_m": knots, "value": [0.0, bend_per_m]}}}


def _s_bend(speed_mps: float, friction: float) -> Content:
    """To the left and to the right, with half of the grip: 4.3 m/s² at the friction 0.85."""
    bend_per_m = min(5.0 * friction / speed_mps**2, SHARPEST_BEND_PER_M)
    bends = [bend_per_m * turn for turn in (0.0, 1.0, 1.0, -1.0, -1.0, 0.0)]
    knots = [at_s * speed_mps for at_s in (1.0, 2.0, 4.5, 6.5, 9.0, 10.0)]
    road = {"curvature_per_m": {"s_m": knots, "value": bends}, "friction": friction}
    return {"road": road, "duration_s": 12.0}


def _stop_and_hold(speed_mps: float) -> Content:
    """Brake from 1 to 6 s, hold for 3 s, drive on."""
    at_s_m = speed_mps + 0.5 * speed_mps * 5.0
    stop = {"at_s_m": at_s_m, "hold_s": 3.0, "deceleration_mps2": speed_mps / 5.0}
    return {"stops": [stop], "duration_s": 12.0}


_SLALOM = {"kind": "sine", "amplitude_m": 0.6, "frequency_hz": 0.4}
MANOEUVRES: dict[str, Callable[[float], Content]] = {
    "lane_change": _lane_change,
    "near_the_limit": partial(_lane_change, change_s=2.1),  # 5 to 5.7 m/s²
    "wet_lane_change": partial(_lane_change, change_s=3.0, friction=0.5),
    "straight": lambda _: {},
    "bend": _bend,
    "s_bend": partial(_s_bend, friction=0.85),
    "wet_s_bend": partial(_s_bend, friction=0.5),
    "slalom": lambda _: {"reference": {"ey_m": _SLALOM}},
    "stop_and_hold": _stop_and_hold,
}
"""what a car does while a fault acts, at any speed in m/s"""


class Case(FileTable):
    """One fault, or several that act together, as in a file."""

    name: str = ""  # of the table in the file
    condition: str = ""  # name of the one in `conditions.toml`; "": none
    faults: tuple[Content, ...]
    initial: Content = Field(default_factory=dict)
    known_limit: str = ""
    """why no reaction keeps the car on its lane; its drives are judged like all others"""
    manoeuvre: Annotated[str, name_in(MANOEUVRES)] = "lane_change"
    payload: Content = Field(default_factory=dict)
    sensors: tuple[Content, ...] = ()  # what the sensors do beside the fault: noise

    @property
    def is_fault_free(self) -> bool:
        """True of the drive without a fault, which nothing may report."""
        return not self.faults and not self.initial

    def scenario(self, speed_kmh: float) -> Scenario:
        """The drive of this case, with the faults."""
        drive = MANOEUVRES[self.manoeuvre](speed_kmh / KMH_PER_MPS)
        faults = [{"start_s": FAULT_START_S} | fault for fault in self.faults]
        noise = [{"start_s": 0.0, "before_drive": True} | fault for fault in self.sensors]
        reference = {"speed_kmh": speed_kmh} | drive.pop("reference", {})
        name = f"{self.name} at {speed_kmh:g} km/h"
        content: Content = {"format": 2, "name": name, "duration_s": DURATION_S, **drive}
        content |= {"reference": reference, "initial": self.initial, "faults": faults + noise}
        return parse_scenario(
            content | {"payload": {"mass_kg": 0.0} | self.payload}, f"fault {self.name}"
        )

    def under(self, condition: str) -> "Case":
        """This case under a condition of `conditions.toml`."""
        changed = {"condition": condition, **CONDITIONS[condition]}
        return Case.model_validate(self.model_dump() | changed)


_CASES: TypeAdapter[dict[str, Case]] = TypeAdapter(Annotated[dict[str, Case], Field(min_length=1)])
CASES_FILE, CONDITIONS_FILE, _DRIFTS_FILE = (
    Path(__file__).with_name(f"{name}.toml") for name in ("cases", "conditions", "drifts")
)
CONDITIONS: dict[str, Content] = tomllib.loads(read_text(CONDITIONS_FILE))


def whole_matrix() -> list[Case]:
    """The cases of `cases.toml` as they are, and those of `drifts.toml` under each condition."""
    drifts = load_cases(_DRIFTS_FILE)
    return [*load_cases(), *(case.under(name) for name in CONDITIONS for case in drifts)]


def load_cases(file: Path = CASES_FILE) -> list[Case]:
    """All cases of a file in its order.

    Raises:
        ConfigError: the file cannot be read, or its content is not one of cases.
    """
    text = read_own(file, "--cases", "docs/faults.md has an example.")
    found = parse(text, _CASES, f"--cases {file}")
    return [case.model_copy(update={"name": name}) for name, case in found.items()]
