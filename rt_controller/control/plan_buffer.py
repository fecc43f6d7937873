"""Inputs of the last good plan, and how many periods ago it was made."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput


class PlanBuffer:
    """Inputs over a horizon, read one a period until a newer plan replaces them."""

    def __init__(self, horizon: int) -> None:
        self._inputs = np.zeros((horizon, len(ControlInput._fields)))
        self.periods_held = horizon
        """periods since the plan was made; at least the horizon if there was none yet"""

    def store(self, inputs: Array) -> ControlInput:
        """First input of a new plan (N, 3), which is copied."""
        self._inputs[:] = inputs
        self.periods_held = 0
        return self._input()

    def store_constant(self, control: ControlInput) -> ControlInput:
        """The same input as a new plan: it is held over the horizon."""
        self._inputs[:] = control
        self.periods_held = 0
        return control

    def next(self, periods: int = 1) -> ControlInput | None:
        """Input of the plan `periods` later; None after its last stage."""
        self.periods_held += periods
        return self._input() if self.periods_held < len(self._inputs) else None

    def _input(self) -> ControlInput:
        return ControlInput(*self._inputs[self.periods_held].tolist())
