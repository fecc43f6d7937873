"""Test sets of simulated drives beyond the recipe of the training data, made on first use.

No preset trains with their seeds. The sets of one road friction or one mass have the same seed, so
the same drivers drive them, but for episodes that are drawn again because a car slid too far.
"""

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from offline.config import PAST_STEPS, STEPS
from offline.data.cache import cache_folder, make_dataset, simulated_origin
from offline.data.dataset import PARTS, Dataset, exists, load_dataset
from offline.data.excitation import Recipe
from offline.data.generate import FIRST_EPSI_RAD, FIRST_EY_M, SLICES, Episode, assemble
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.data.variation import VARIED as VARIED_CONDITIONS
from offline.data.variation import Variation
from offline.evaluation.test_sets import (
    BRAKING,
    FAST,
    FRICTION,
    MASS,
    ROBUSTNESS,
    SLIDING,
    VARIED,
    TestSet,
    cut_set,
    describe_source,
    slices_of_test_part,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.schema import VEHICLE
from rt_controller.contract.signals import InputColumn
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.frenet import integrate_poses
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import default_car

NOMINAL_FRICTION = 0.85
"""of the shipped car's road, which is that of the training data"""

_CONDITIONS_SEED = 46_049

BRAKING_FROM_KMH = tuple(range(90, 131, 2))
"""the car still moves at the end of each drive"""
PRESSED_AT_S = (1.6, 1.2, 0.8, 0.4, -0.4)
"""beginning of the brake after the beginning of each of the five windows"""
BRAKING_SEED = 46_050


@dataclass(frozen=True, slots=True)
class SimulatedSet:
    """What a test set is simulated with."""

    name: str
    options: tuple[str, ...]
    """names of `--sets` that it belongs to"""
    recipe: Recipe
    episodes: int
    """of five slices each"""
    seed: int
    conditions: str
    """what differs from the training data, as text"""


def _kmh(low: float, high: float) -> tuple[float, float]:
    return low / 3.6, high / 3.6


def _conditions(
    name: str, options: tuple[str, ...], variation: Variation, conditions: str
) -> SimulatedSet:
    recipe = Recipe(variation=variation)
    return SimulatedSet(name, options, recipe, 96, _CONDITIONS_SEED, conditions)


def _friction(value: float) -> SimulatedSet:
    variation = Variation(friction=(value, value))
    return _conditions(f"{FRICTION}-{value:g}", (FRICTION,), variation, f"road friction {value:g}")


def _mass(factor: float) -> SimulatedSet:
    variation = Variation(mass_factor=(factor, factor))
    return _conditions(f"{MASS}-{factor:g}", (MASS,), variation, f"mass times {factor:g}")


NOMINAL = _conditions(
    "nominal",
    (FRICTION, MASS),
    Variation(friction=(NOMINAL_FRICTION, NOMINAL_FRICTION)),
    "road and car of the training data",
)
BY_FRICTION = {1.0: _friction(1.0), NOMINAL_FRICTION: NOMINAL} | {
    value: _friction(value) for value in (0.7, 0.5)
}
BY_MASS_FACTOR = {0.85: _mass(0.85), 1.0: NOMINAL, 1.15: _mass(1.15)}

SIMULATED = (
    SimulatedSet(
        ROBUSTNESS,
        (ROBUSTNESS,),
        Recipe(variation=Variation(friction=(0.5, 1.0), mass_factor=(0.85, 1.15))),
        96,
        46_046,
        "road friction 0.5 to 1, mass times 0.85 to 1.15",
    ),
    SimulatedSet(
        VARIED,
        (VARIED,),
        Recipe(variation=VARIED_CONDITIONS),
        96,
        46_051,
        "road, wind, load and tyres as in the recipe varied",
    ),
    SimulatedSet(
        SLIDING,
        (SLIDING,),
        Recipe(first_speed_mps=_kmh(110.0, 130.0), steering_knots=(3,)),
        400,
        46_047,
        "110 to 130 km/h at the start of an episode, and steering through a random angle every "
        "0.67 s, with which this car slides most",
    ),
    SimulatedSet(
        FAST,
        (FAST,),
        Recipe(first_speed_mps=_kmh(130.0, 180.0)),
        96,
        46_048,
        "130 to 180 km/h at the start of an episode",
    ),
    *dict.fromkeys((*BY_FRICTION.values(), *BY_MASS_FACTOR.values())),
)


def open_simulated_set(which: SimulatedSet) -> tuple[Dataset, TestSet]:
    """All drives of the set, and their data set, from the cache or made now in this process."""
    origin = simulated_origin(which.recipe, which.episodes, which.seed)
    folder = cache_folder(origin)
    if exists(folder):
        dataset = load_dataset(folder)
    else:
        part = np.full(which.episodes, PARTS.index("test"), dtype=np.int8)
        dataset = make_dataset(folder, origin, part, jobs=1)
    description = f"{describe_source(origin)}, {which.conditions}"
    return dataset, cut_set(dataset, which.name, description, slices_of_test_part(dataset))


def straight_braking_set() -> TestSet:
    """Straight stops of the simulated car with the full brake.

    The wheel stays straight, the pedal follows 0 to 150 N at its rate. In four of the five windows
    of a drive the brake begins within the window, in the last it acts from the start. The road is
    straight; each window has its own lateral and heading error, as the slices of the data sets.
    Simulated within a second, so they are not kept.
    """
    pressed = PAST_STEPS + _periods(max(PRESSED_AT_S))
    inputs = np.zeros((pressed + STEPS - _periods(min(PRESSED_AT_S)), 3))
    ramp_n = INPUT_LIMITS.rate_per_s.brake_n * PERIOD_S * np.arange(1, len(inputs) - pressed + 1)
    inputs[pressed:, InputColumn.brake_n] = np.minimum(ramp_n, INPUT_LIMITS.upper.brake_n)
    rng = np.random.default_rng(BRAKING_SEED)
    drives = assemble([_stop(speed / 3.6, inputs, rng) for speed in BRAKING_FROM_KMH])
    first = [pressed - _periods(after_s) for after_s in PRESSED_AT_S]
    starts = drives.slices._replace(row=np.add.outer(drives.recording.first, first).ravel())
    trajectories = cut(drives.recording, starts, VEHICLE, VEHICLE_ROLES)
    numbers = b"".join(array.tobytes() for array in trajectories if array is not None)
    description = (
        f"{len(BRAKING_FROM_KMH)} straight stops from {BRAKING_FROM_KMH[0]} to "
        f"{BRAKING_FROM_KMH[-1]} km/h with {INPUT_LIMITS.upper.brake_n:g} N"
    )
    digest = sha256(numbers).hexdigest()
    return TestSet(BRAKING, description, trajectories, np.zeros(len(starts.row)), digest)


def _stop(first_speed_mps: float, inputs: Array, rng: np.random.Generator) -> Episode:
    car = default_car()
    motion, _ = simulate(settle(first_speed_mps, car), inputs, car, STEPS_PER_PERIOD, STEP_S)
    pose = integrate_poses(motion, 0.0, 0.0, 0.0, STEPS_PER_PERIOD, STEP_S)
    errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    return Episode(motion[::STEPS_PER_PERIOD], pose, inputs, 0.0, errors, 0)


def _periods(duration_s: float) -> int:
    return round(duration_s / PERIOD_S)
