"""Random trajectories, and predictors with known errors."""

import numpy as np

from offline.data.signals import Trajectories
from offline.evaluation import test_sets


def made_trajectories(count, steps=80, states=6, slices=5, seed=0):
    """`count` trajectories of random numbers, `slices` of each episode."""
    rng = np.random.default_rng(seed)

    def numbers(*shape):
        return rng.normal(size=(count, *shape)).astype(np.float32)

    episode = (np.arange(count) // slices).astype(np.int32)
    return Trajectories(
        numbers(steps + 1, states), numbers(steps, 3), numbers(steps, 1), numbers(20, 6), episode
    )


def made_test_set(trajectories, name="library"):
    """These trajectories as a test set."""
    return test_sets.TestSet(name, "random", trajectories, "0" * 64)


class WithError:
    """Predicts these trajectories with a given error (N, K+1, n)."""

    def __init__(self, trajectories, error):
        self._known = trajectories.x.astype(float)
        self._wrong = self._known + error

    def predict(self, x0, past, U, W):
        """The trajectories are recognised by their first state."""
        place = np.argmax(np.all(x0[:, None] == self._known[None, :, 0], axis=-1), axis=1)
        return self._wrong[place]


def with_random_error(trajectories, factor=1.0, seed=0):
    """Predictor with normally distributed errors of this standard deviation."""
    rng = np.random.default_rng(seed)
    return WithError(trajectories, factor * rng.normal(size=trajectories.x.shape))
