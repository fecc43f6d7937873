"""The last good plan, and how far along it we are."""

import numpy as np

from rt_controller.contract.artifact import Array
from rt_controller.contract.signals import ControlInput


class Plan:
    """Inputs of a horizon, taken one a tick until a newer plan replaces them."""

    def __init__(self, horizon: int) -> None:
        self._inputs = np.zeros((horizon, len(ControlInput._fields)))
        self._stage = horizon

    def renew(self, inputs: Array) -> ControlInput:
        """Take over a fresh plan (N, 3); its first input."""
        self._inputs[:] = inputs
        self._stage = 0
        return self._input()

    def follow(self) -> ControlInput | None:
        """The next input of the plan we have; None when it has run out."""
        self._stage = min(self._stage + 1, self._inputs.shape[0])
        return self._input() if self._stage < self._inputs.shape[0] else None

    @property
    def ticks_held(self) -> int:
        """Ticks since the plan was fresh; the horizon, if there is none."""
        return self._stage

    def _input(self) -> ControlInput:
        throttle, brake_n, steer_rad = self._inputs[self._stage].tolist()
        return ControlInput(throttle, brake_n, steer_rad)
