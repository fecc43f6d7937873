"""The rival that any model must beat: nothing changes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PersistencePredictor:
    """Predicts that the first state lasts."""

    def predict(self, x0: Array, U: Array, kappa: Array) -> Array:
        """States (batch, K+1, 6), all equal to x0 (batch, 6)."""
        return np.repeat(x0[:, None, :], U.shape[1] + 1, axis=1)
