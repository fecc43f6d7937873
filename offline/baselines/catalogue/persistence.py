"""Persistence: the first state holds over the whole horizon."""

from dataclasses import dataclass

import numpy as np

from offline.baselines.baseline import Baseline
from rt_controller.contract.arrays import Array
from rt_controller.report.table import Fact


@dataclass(frozen=True, slots=True)
class Persistence:
    """Predicts the first state for all steps."""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), all equal to x0 (batch, n)."""
        return np.repeat(x0[:, None, :], U.shape[1] + 1, axis=1)

    def fit_info(self) -> tuple[Fact, ...]:
        """Nothing: there is nothing to fit."""
        return ()


BASELINE = Baseline(fit=lambda dataset: Persistence())
