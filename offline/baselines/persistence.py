"""The rival that any model must beat: nothing changes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.baselines.finding import Finding
from offline.dataset import Dataset

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PersistencePredictor:
    """Predicts that the first state lasts."""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), all equal to x0 (batch, n)."""
        return np.repeat(x0[:, None, :], U.shape[1] + 1, axis=1)

    def findings(self) -> tuple[Finding, ...]:
        """None: there is nothing to fit."""
        return ()


def fit_persistence(dataset: Dataset) -> PersistencePredictor:
    """The same for all data."""
    return PersistencePredictor()
