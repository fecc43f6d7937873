"""Test sets of simulated drives beyond the recipe of the training data, made on first use.

No preset trains with their seeds. The sets of one road friction or one mass have the same seed, so
the same drivers drive them, but for episodes that are drawn again because a car slid too far.
"""

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from offline.config import PAST_STEPS, STEPS
from offline.data.dataset import Dataset, cache_folder, exists, load_dataset
from offline.data.generate import (
    FIRST_EPSI_RAD,
    FIRST_EY_M,
    SLICES,
    Episode,
    assemble,
    make_dataset,
    simulated_origin,
)
from offline.data.manifest import PARTS
from offline.data.recipe import Recipe
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
from rt_controller.contract.signals import VEHICLE, InputColumn
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.campaign import Backend
from sim_bridge.frenet import integrate_poses
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, settle, simulate
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
    conditions: str
    """what differs from the training data, as text"""
    recipe: Recipe
    seed: int
    options: tuple[str, ...]
    """names of `--sets` that it belongs to"""
    episodes: int = 96
    """of five slices each"""


def _same_drivers(name: str, conditions: str, *options: str, **values: float) -> SimulatedSet:
    ranges = {field: (value, value) for field, value in values.items()}
    recipe = Recipe(variation=Variation.model_validate(ranges))
    return SimulatedSet(name, conditions, recipe, _CONDITIONS_SEED, options)


SIMULATED = (
    SimulatedSet(
        ROBUSTNESS,
        "road friction 0.5 to 1, mass times 0.85 to 1.15",
        Recipe(variation=Variation(friction=(0.5, 1.0), mass_factor=(0.85, 1.15))),
        46_046,
        (ROBUSTNESS,),
    ),
    SimulatedSet(
        VARIED,
        "road, wind, load and tyres as in the recipe varied",
        Recipe(variation=VARIED_CONDITIONS),
        46_051,
        (VARIED,),
    ),
    SimulatedSet(
        SLIDING,
        "110 to 130 km/h at the start of an episode, and steering through a random angle every "
        "0.67 s, with which this car slides most",
        Recipe(first_speed_mps=(110.0 / 3.6, 130.0 / 3.6), steering_knots=(3,)),
        46_047,
        (SLIDING,),
        episodes=400,
    ),
    SimulatedSet(
        FAST,
        "130 to 180 km/h at the start of an episode",
        Recipe(first_speed_mps=(130.0 / 3.6, 180.0 / 3.6)),
        46_048,
        (FAST,),
    ),
    _same_drivers("friction-1", "road friction 1", FRICTION, friction=1.0),
    _same_drivers(
        "nominal", "road and car of the training data", FRICTION, MASS, friction=NOMINAL_FRICTION
    ),
    _same_drivers("friction-0.7", "road friction 0.7", FRICTION, friction=0.7),
    _same_drivers("friction-0.5", "road friction 0.5", FRICTION, friction=0.5),
    _same_drivers("mass-0.85", "mass times 0.85", MASS, mass_factor=0.85),
    _same_drivers("mass-1.15", "mass times 1.15", MASS, mass_factor=1.15),
)


def open_simulated_set(which: SimulatedSet) -> tuple[Dataset, TestSet]:
    """All drives of the set, and their data set, from the cache or made now in this process."""
    origin = simulated_origin(which.recipe, which.episodes, which.seed)
    folder = cache_folder(origin)
    if exists(folder):
        dataset = load_dataset(folder)
    else:
        part = np.full(which.episodes, PARTS.index("test"), dtype=np.int8)
        dataset = make_dataset(folder, origin, part, Backend(jobs=1))
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
    numbers = b"".join(array.tobytes() for array in trajectories)
    description = (
        f"{len(BRAKING_FROM_KMH)} straight stops from {BRAKING_FROM_KMH[0]} to "
        f"{BRAKING_FROM_KMH[-1]} km/h with {INPUT_LIMITS.upper.brake_n:g} N"
    )
    digest = sha256(numbers).hexdigest()
    return TestSet(BRAKING, description, trajectories, digest)


def _stop(first_speed_mps: float, inputs: Array, rng: np.random.Generator) -> Episode:
    car = default_car()
    motion, _ = simulate(settle(first_speed_mps, car), inputs, car, STEPS_PER_PERIOD, STEP_S)
    pose = integrate_poses(motion, 0.0, 0.0, 0.0, STEPS_PER_PERIOD, STEP_S)
    errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    return Episode(motion[::STEPS_PER_PERIOD], pose, inputs, 0.0, errors, 0)


def _periods(duration_s: float) -> int:
    return round(duration_s / PERIOD_S)
