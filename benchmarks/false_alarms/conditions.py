"""The drives: every scenario with varied friction and load, and with noise of the sensors."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count
from typing import NamedTuple

import numpy as np

from rt_controller.contract.signals import VehicleState
from sim_bridge.plant.payload import Payload
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.scenario.faults import Fault
from sim_bridge.scenario.files.fault_fields import FaultFields

NOISE = VehicleState(
    vx_mps=0.03, vy_mps=0.03, yaw_rate_radps=0.002, ds_m=0.001, ey_m=0.015, epsi_rad=0.0015
)
"""standard deviation in each period: wheel speeds, a yaw rate sensor and a lane camera"""
OFFSET = VehicleState(
    vx_mps=0.0, vy_mps=0.02, yaw_rate_radps=0.0015, ds_m=0.0, ey_m=0.0, epsi_rad=0.0015
)
"""largest constant error of each signal, drawn for each drive"""
CURVATURE_NOISE_PER_M = 1e-4
FRICTION = (0.5, 1.0)
MASS_KG = (-225.0, 225.0)
"""15 % of the car"""
EARLIEST_STOP_S = 1.0
_OFFSETS = tuple((name, most) for name, most in OFFSET._asdict().items() if most > 0.0)
_CORNERS = tuple((friction, mass_kg) for friction in FRICTION for mass_kg in MASS_KG)


class Condition(NamedTuple):
    """One drive."""

    scenario: str
    friction: float
    mass_kg: float
    """beside that of the car"""
    seed: int
    stop_at_s: float | None
    """the controller is asked to end the drive after this time; None: at the end of the scenario"""


def conditions(scenarios: Sequence[str]) -> Iterator[Condition]:
    """All scenarios with the first seed, then with the next, without an end.

    The first four seeds have the extremes of friction and mass, later ones what is drawn between.
    Odd seeds end in a stop that is requested at any time of the scenario.
    """
    duration_s = {name: load_scenario(name).duration_s for name in scenarios}
    for seed in count():
        for index, name in enumerate(scenarios):
            rng = np.random.default_rng((seed, index))
            friction, mass_kg = float(rng.uniform(*FRICTION)), float(rng.uniform(*MASS_KG))
            stop_at_s = round(float(rng.uniform(EARLIEST_STOP_S, duration_s[name])), 3)
            if seed < len(_CORNERS):
                friction, mass_kg = _CORNERS[seed]
            yield Condition(
                name,
                round(friction, 3),
                round(mass_kg, 1),
                seed,
                stop_at_s if seed % 2 == 1 else None,
            )


def disturbed(condition: Condition) -> Scenario:
    """The scenario of a condition, with noise and offsets on all states."""
    rng = np.random.default_rng((condition.seed, len(condition.scenario)))
    scenario = load_scenario(condition.scenario)
    spread = {**NOISE._asdict(), "curvature_per_m": CURVATURE_NOISE_PER_M}
    faults = [_noise(name, std, int(rng.integers(1 << 30))) for name, std in spread.items()]
    faults += [_offset(name, float(rng.uniform(-most, most))) for name, most in _OFFSETS]
    changed = replace(scenario, payload=Payload(mass_kg=condition.mass_kg), faults=tuple(faults))
    is_split = scenario.name.startswith("braking on split")  # its friction is part of the scenario
    return changed if is_split else changed.with_friction(condition.friction)


def _noise(signal: str, value: float, seed: int) -> Fault:
    return FaultFields(kind="noise", signals=(signal,), value=value, seed=seed).fault


def _offset(signal: str, value: float) -> Fault:
    return FaultFields(kind="bias", signals=(signal,), value=value).fault
