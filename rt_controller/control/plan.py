"""The last good plan, and how far along it we are."""

import numpy as np

from rt_controller.contract.bundle import Array
from rt_controller.contract.signals import ControlInput


class Plan:
    """Inputs of a horizon, taken one a period until a newer plan replaces them."""

    def __init__(self, horizon: int) -> None:
        self._inputs = np.zeros((horizon, len(ControlInput._fields)))
        self._stage = horizon
        self.periods_held = horizon
        """since the plan was fresh; at least the horizon, if there never was one"""

    def renew(self, inputs: Array) -> ControlInput:
        """Take over a fresh plan (N, 3); its first input."""
        self._inputs[:] = inputs
        self._stage = self.periods_held = 0
        return self._input()

    def follow(self, periods: int = 1) -> ControlInput | None:
        """The input that the plan has for `periods` later; None when it has run out."""
        self.periods_held += periods
        self._stage = min(self._stage + periods, self._inputs.shape[0])
        return self._input() if self._stage < self._inputs.shape[0] else None

    def _input(self) -> ControlInput:
        throttle, brake_n, steer_rad = self._inputs[self._stage].tolist()
        return ControlInput(throttle, brake_n, steer_rad)
