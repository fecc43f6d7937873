"""The data set of cars and roads that no model learned from, in the cache like any other.

Its slices are for judging only: every episode is of the test part.
"""

import numpy as np

from offline.dataset import PARTS, Dataset, cache, exists, load_dataset
from offline.excitation import Recipe
from offline.generate import generate, plant_fingerprint
from offline.manifest import Driven
from offline.stock import keep

RECIPE = Recipe(road_friction=(0.5, 1.0), mass_factor=(0.85, 1.15))
EPISODES = 96
"""of five slices: 480 trajectories"""
SEED = 46_046
"""far from those that people give their training data"""


def ensure_robustness_data(jobs: int = 1, episodes: int = EPISODES) -> Dataset:
    """The data set, made now if the cache has none of today's car.

    It takes seconds; starting processes would take longer.
    """
    origin = Driven(RECIPE, episodes, SEED, plant_fingerprint())
    folder = cache() / origin.name
    if exists(folder):
        return load_dataset(folder)
    part = np.full(episodes, PARTS.index("test"), dtype=np.int8)
    return keep(folder, generate(RECIPE, episodes, SEED, jobs), part, origin)
