"""Trajectories made by hand, and predictors whose errors are known beforehand."""

import numpy as np

from offline import test_sets
from offline.trajectories import Trajectories


def made_trajectories(count, steps=80, states=6, slices=5, seed=0):
    """`count` trajectories of numbers at random, so many slices an episode."""
    rng = np.random.default_rng(seed)

    def numbers(*shape):
        return rng.normal(size=(count, *shape)).astype(np.float32)

    episode = (np.arange(count) // slices).astype(np.int32)
    return Trajectories(
        numbers(steps + 1, states), numbers(steps, 3), numbers(steps, 1), numbers(20, 6), episode
    )


def judged_on(trajectories, curvature_per_m=None, name="library"):
    """These trajectories as a set that models are judged on."""
    return test_sets.TestSet(name, "made by hand", trajectories, curvature_per_m, "0" * 64)


class Off:
    """Knows the future of these trajectories, and misses it by a given error (N, K+1, n)."""

    def __init__(self, trajectories, error):
        self._known = trajectories.x.astype(float)
        self._wrong = self._known + error

    def predict(self, x0, past, U, W):
        """Of any of the trajectories, found by their first state."""
        place = np.argmax(np.all(x0[:, None] == self._known[None, :, 0], axis=-1), axis=1)
        return self._wrong[place]


def scattered(trajectories, factor=1.0, seed=0):
    """Misses by so many times the numbers of a stream of chance."""
    rng = np.random.default_rng(seed)
    return Off(trajectories, factor * rng.normal(size=trajectories.x.shape))


class Hold:
    """Predicts that the first state lasts."""

    def predict(self, x0, past, U, W):
        return np.repeat(x0[:, None], U.shape[1] + 1, axis=1)
