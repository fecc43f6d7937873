"""What the arrays handed to a fitted rival must look like."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import DatasetError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WindowShape:
    """How many signals of each kind a rival was fitted to, and how much past it needs."""

    states: int
    inputs: int
    exogenous: int
    remembered: int = 0
    """signals in one row of the past; 0: it never looks there"""
    past_steps: int = 0
    """rows of the past it needs at least"""

    def require(self, x0: Array, past: Array, U: Array, W: Array) -> None:
        """Return if `Predictor.predict` may go on with these.

        Raises:
            DatasetError: a shape does not fit the rival or the other arrays.
        """
        batch, steps = len(x0), U.shape[1] if U.ndim > 1 else 0
        fits = (
            x0.shape == (batch, self.states)
            and U.shape == (batch, steps, self.inputs)
            and W.shape == (batch, steps, self.exogenous)
            and past.ndim == 3
            and len(past) == batch
            and past.shape[1] >= self.past_steps
            and self.remembered in (0, past.shape[2])
        )
        if not fits:
            raise DatasetError(
                f"expected x0 (batch, {self.states}), past (batch, {self.past_steps} or more, "
                f"{self.remembered or 'any'}), U (batch, K, {self.inputs}) and W (batch, K, "
                f"{self.exogenous}), found {x0.shape}, {past.shape}, {U.shape} and {W.shape}. "
                f"Predict on windows of the signals that the rival was fitted to."
            )
