"""Open-loop predictions of a driven car that began in the last periods, advanced together."""

from collections.abc import Callable

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, ControlInput
from rt_controller.model.dynamics import Dynamics, Step

STEPS = 10
OneStep = Callable[[Array, ControlInput, float], Array]
"""lifted states (..., n) a period after psi (..., n), under an input, at a curvature in 1/m"""


class DrivenStep:
    """One step of the model under an input of the car on a road of one curvature."""

    def __init__(self, model: Dynamics) -> None:
        self._step = Step(model)
        self._inputs = np.ones(N_INPUTS + 2)
        """inputs, curvature, and 1"""

    def __call__(self, psi: Array, control: ControlInput, curvature_per_m: float) -> Array:
        """Lifted states (..., n) a period after psi (..., n)."""
        self._inputs[:-1] = *control, curvature_per_m
        return self._step(psi, self._inputs)


class RollOuts:
    """One roll-out for each of the last ten periods.

    Paper: eq. (8).
    """

    def __init__(self, n_observables: int, step: OneStep) -> None:
        self._step = step
        self._psi = np.zeros((STEPS, n_observables))
        self._newest = 0
        self.begun = 0
        """in a row without a gap between them"""

    def begin(self, psi: Array) -> None:
        """Begin one at the lifted state (n,) of this period; the oldest one ends."""
        self._newest = (self._newest + 1) % STEPS
        self._psi[self._newest] = psi
        self.begun += 1

    def after(self, control: ControlInput, curvature_per_m: float) -> Array:
        """Lifted states (10, n) of all of them after a period under `control`."""
        return self._step(self._psi, control, curvature_per_m)

    def advance(self, after: Array) -> None:
        """Take the states (10, n) of `after` as the present ones."""
        self._psi = after

    def restart_from_oldest(self) -> None:
        """Go on with the oldest one alone: later lifted states were wrong."""
        self._newest = (self._newest + 1) % STEPS
        self.begun = 1

    @property
    def newest(self) -> Array:
        """(n,), of the one that began last."""
        found: Array = self._psi[self._newest]
        return found

    @property
    def oldest(self) -> Array:
        """(n,), of the one that began ten periods ago."""
        found: Array = self._psi[(self._newest + 1) % STEPS]
        return found
