"""The car's past as an encoder is shown it: whole, or begun anew."""

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.signals import ControlInput, VehicleState

Rows = NDArray[np.float32]


class History:
    """The last H pairs of a state and the input that acted from it to the next, oldest first.

    Before the oldest state that is known the car is taken to have been in that state all the time,
    under the input that was in force when it was seen. So every row is one that a car can have,
    the first tick is defined, and after H periods nothing is left of the assumption.
    """

    def __init__(self, rows: Rows) -> None:
        """`rows` (H, 6), columns as `fitness.DRIVABLE_HISTORY`: the encoder's memory."""
        self._rows = rows
        # Every row is kept twice, H apart: then the last H always lie side by side.
        self._ring = np.zeros((2 * rows.shape[0], rows.shape[1]), dtype=np.float32)
        self._next = 0
        self._present: VehicleState | None = None

    @property
    def is_begun(self) -> bool:
        """Whether there is a past to show."""
        return self._present is not None

    def advance(self, state: VehicleState, held: ControlInput) -> None:
        """The car is at `state` now; `held` was in force for the period that ended here."""
        if self._present is None:
            self._ring[:] = _row(state, held)
        else:
            steps = self._rows.shape[0]
            self._ring[self._next :: steps] = _row(self._present, held)
            self._next = (self._next + 1) % steps
        self._rows[:] = self._ring[self._next : self._next + self._rows.shape[0]]
        self._present = state

    def forget(self) -> None:
        """Nothing is known of what comes before the next state."""
        self._present = None


def _row(state: VehicleState, held: ControlInput) -> tuple[float, ...]:
    return (state.vx_mps, state.vy_mps, state.yaw_rate_radps, *held)
