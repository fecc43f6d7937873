"""Drives of the golden trajectories: `python golden_drives.py` records them again.

The file holds what the plant answered when it was recorded. A plant that answers otherwise has
changed: record again only if that was intended.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from made_tyre import TYRE_FILE_TEXT

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import Parameters, load_parameters
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.shipped_cars import DEFAULT_CAR, shipped_cars
from sim_bridge.plant.tyre_file import parse_tyre_file

GOLDEN_FILE = Path(__file__).parents[2] / "sim_bridge" / "golden" / "trajectories.npz"
N_PERIODS = 100
STEPS_PER_PERIOD = 25
STEP_S = 0.001
OUTPUTS_EVERY = 10
"""of the rows of outputs, those that are kept; of the motion the rows at the periods' ends"""
MADE_TYRE = "made tyre file"


class Drive(NamedTuple):
    """A start, a kind of driver and a kind of road."""

    v0_mps: float
    throttle: float
    """largest"""
    brake_n: float
    """largest"""
    wheel_rad: float
    """largest"""
    roads: tuple[RoadParameters, ...]
    """each for an equal part of the drive"""


_DRY = RoadParameters(0.85, 0.85)
_SPLIT = RoadParameters(0.9, 0.25)
_UPHILL = RoadParameters(0.85, 0.7, -0.08, 0.12, wind_forward_mps=-9.0, wind_left_mps=7.0)
_DOWNHILL = RoadParameters(0.7, 0.85, 0.1, -0.1, wind_forward_mps=6.0, wind_left_mps=-11.0)
_ICE = RoadParameters(0.15, 0.15)

DRIVES = {
    "limit_handling": Drive(35.0, 1.0, 200.0, 2.0, (_DRY,)),
    "from_rest": Drive(0.0, 1.0, 0.0, 0.5, (_DRY, _SPLIT)),
    "to_rest": Drive(9.0, 0.0, 150.0, 0.5, (_DRY,)),
    "standstill": Drive(0.0, 0.0, 80.0, 4.0, (_UPHILL,)),
    "creep": Drive(1.5, 0.1, 20.0, 6.0, (_DRY, _DOWNHILL)),
    "split_friction": Drive(30.0, 0.6, 250.0, 1.0, (_SPLIT,)),
    "slopes_and_wind": Drive(22.0, 1.0, 150.0, 1.0, (_UPHILL, _DOWNHILL, _DRY)),
    "locked_on_ice": Drive(20.0, 0.8, 400.0, 2.0, (_ICE,)),
    "through_the_gears": Drive(14.0, 1.0, 40.0, 0.1, (_DRY,)),
}


def golden_cars() -> dict[str, Parameters]:
    """The shipped cars, and the default car with the tyres of a file."""
    cars = {name: load_parameters(name) for name in shipped_cars()}
    tyre_file = parse_tyre_file(TYRE_FILE_TEXT, "made")
    return {**cars, MADE_TYRE: cars[DEFAULT_CAR]._replace(tyre_file=tyre_file)}


def inputs_and_roads(drive: Drive, seed: int) -> tuple[Array, Array]:
    """(K, 3) pedals and wheel, new every half second, and (K, 6) roads."""
    rng = np.random.default_rng(seed)
    inputs = np.empty((N_PERIODS, 3))
    for first in range(0, N_PERIODS, 20):
        brakes = rng.random() < (1.0 if drive.throttle == 0.0 else 0.4)
        share, wheel = rng.uniform(0.5, 1.0), rng.uniform(-1.0, 1.0)
        pedals = (0.0, share * drive.brake_n) if brakes else (share * drive.throttle, 0.0)
        inputs[first : first + 20] = (*pedals, wheel * drive.wheel_rad)
    which = np.arange(N_PERIODS) * len(drive.roads) // N_PERIODS
    return inputs, np.array(drive.roads)[which]


def trajectories(
    settle: Callable[[float, Parameters], Array],
    simulate: Callable[[Array, Array, Parameters, int, float, Array], tuple[Array, Array]],
) -> dict[str, Array]:
    """First state, motion and outputs of each car and drive, by name."""
    results: dict[str, Array] = {}
    for car, parameters in golden_cars().items():
        for seed, (name, drive) in enumerate(DRIVES.items()):
            inputs, roads = inputs_and_roads(drive, seed)
            at_start = parameters._replace(road=RoadParameters(*roads[0].tolist()))
            state0 = settle(drive.v0_mps, at_start)
            motion, outputs = simulate(state0, inputs, at_start, STEPS_PER_PERIOD, STEP_S, roads)
            key = f"{car}/{name}"
            results[f"{key}/state0"] = state0
            results[f"{key}/motion"] = motion[::STEPS_PER_PERIOD].copy()
            results[f"{key}/outputs"] = outputs[::OUTPUTS_EVERY].copy()
    return results


def wandering_inputs(n_periods: int) -> list[ControlInput]:
    """Other inputs in every period: drive, brake, and steering to both sides."""
    t = np.arange(n_periods) * PERIOD_S
    return [
        ControlInput(max(0.0, np.sin(x)), 60.0 * max(0.0, -np.sin(x)), float(s))
        for x, s in zip(t, 0.6 * np.sin(1.7 * t), strict=True)
    ]


if __name__ == "__main__":
    from sim_bridge.plant.library import settle, simulate

    GOLDEN_FILE.parent.mkdir(exist_ok=True)
    np.savez_compressed(GOLDEN_FILE, **trajectories(settle, simulate))
