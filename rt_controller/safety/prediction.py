"""Predictions of the motion of this tick by the model, from the states of the last ten ticks."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.rollout import Dynamics, Step
from rt_controller.contract.signals import ControlInput

STEPS = 10
LONGEST = 80
"""steps of a roll-out: one of two seconds is more accurate than to lift the predicted state again
in every period"""

_N_INPUTS = len(ControlInput._fields)


class MotionPrediction:
    """Ten open-loop roll-outs of the model, begun in the last ten ticks, advanced together.

    Paper: eq. (8).
    """

    def __init__(self, model: Dynamics, n_observables: int) -> None:
        self._psi = np.zeros((STEPS, n_observables))
        self._step = Step(model)
        self._inputs = np.ones(_N_INPUTS + 2)
        """inputs, curvature, and 1"""
        self._newest = 0
        self._age_of_newest = 0
        self._begun = 0
        """roll-outs in a row without a gap between them"""

    @property
    def has_any(self) -> bool:
        return self._begun > 0

    @property
    def has_ten(self) -> bool:
        """True if a roll-out was begun ten ticks ago."""
        return self._begun >= STEPS and self._age_of_newest == 1

    @property
    def is_old(self) -> bool:
        """True if the newest roll-out is longer than those that the model was trained with."""
        return self._age_of_newest >= LONGEST

    def begin(self, psi: Array) -> None:
        """Begin a roll-out at the lifted state (n,) of this tick; the oldest one ends."""
        self._newest = (self._newest + 1) % STEPS
        self._psi[self._newest] = psi
        self._begun = self._begun + 1 if self._age_of_newest <= 1 else 1
        self._age_of_newest = 0

    def advance(self, applied: ControlInput, curvature_per_m: float) -> None:
        """Advance all roll-outs by the period in which `applied` acted."""
        self._inputs[:-1] = *applied, curvature_per_m
        self._psi = self._step(self._psi, self._inputs)
        self._age_of_newest += 1

    def fall_back(self) -> None:
        """Go on with the roll-out that began ten ticks ago, since later states were faulty."""
        if self.has_ten:
            self._newest = (self._newest + 1) % STEPS
            self._age_of_newest = STEPS
            self._begun = 1

    def clear(self) -> None:
        """End all roll-outs."""
        self._begun = self._age_of_newest = 0

    def newest(self) -> tuple[float, float, float]:
        """(v_x, v_y, yaw rate) by the roll-out that began last."""
        vx, vy, yaw_rate = self._psi[self._newest, :3].tolist()
        return vx, vy, yaw_rate

    def oldest(self) -> tuple[float, float, float]:
        """The same by the one that began ten ticks ago."""
        vx, vy, yaw_rate = self._psi[(self._newest + 1) % STEPS, :3].tolist()
        return vx, vy, yaw_rate
