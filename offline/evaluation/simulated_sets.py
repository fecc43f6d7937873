"""Test sets of simulated drives beyond the recipe of the training data, made on first use.

No preset trains with their seeds. The sets of one road friction or one mass have the same seed, so
the same drivers drive them, but for episodes that are drawn again because a car slid too far.
"""

from dataclasses import dataclass

import numpy as np

from offline.data.cache import cache_folder, make_dataset, simulated_origin
from offline.data.dataset import PARTS, Dataset, exists, load_dataset
from offline.data.excitation import Recipe
from offline.data.variation import VARIED as VARIED_CONDITIONS
from offline.data.variation import Variation
from offline.evaluation.test_sets import (
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

NOMINAL_FRICTION = 0.85
"""of the shipped car's road, which is that of the training data"""

_CONDITIONS_SEED = 46_049


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
