"""Predictions of the motion of this tick by the model, from the states of the last ten ticks."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.rollout import Dynamics
from rt_controller.contract.signals import ControlInput

STEPS = 10
LONGEST = 80
"""steps of a roll-out: one of two seconds is more accurate than to lift the predicted state again
in every period"""

_N_INPUTS = len(ControlInput._fields)


class MotionPrediction:
    """Ten open-loop roll-outs of the model, begun in the last ten ticks, advanced together.

    The step is that of `contract.model.rollout.one_step`, with its matrices arranged once: it takes
    half of the time of all checks.

    Paper: eq. (8).
    """

    def __init__(self, model: Dynamics, n_observables: int) -> None:
        self._psi = np.zeros((STEPS, n_observables))
        self._A_T = np.ascontiguousarray(model.A.T)
        inputs = np.hstack((model.B_uc, model.B_uw, np.asarray(model.c)[:, None]))
        self._inputs = np.ascontiguousarray(inputs.T)
        self._u = np.ones(len(self._inputs))
        """inputs, curvature, and 1 for the offset"""
        bilinear = model.bilinear
        self._is_bilinear = bilinear is not None
        if bilinear is not None:
            self._S_T = np.ascontiguousarray(bilinear.S.reshape(-1, n_observables).T)
            self._s0 = bilinear.s0.reshape(-1)
            self._N = bilinear.N.transpose(0, 2, 1).reshape(-1, n_observables)
            self._repeated = np.zeros(bilinear.s0.shape)
            self._saturates = bilinear.saturates
        self._drift = model.drift
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
        u, psi = self._u, self._psi
        u[:_N_INPUTS] = applied
        u[_N_INPUTS] = curvature_per_m
        following = psi @ self._A_T
        following += u @ self._inputs
        if self._is_bilinear:
            self._repeated[:] = u[:_N_INPUTS]
            gains = psi @ self._S_T
            gains += self._s0
            if self._saturates:
                np.tanh(gains, out=gains)
            gains *= self._repeated.reshape(-1)
            following += gains @ self._N
        if self._drift is not None:
            following += self._drift.terms(psi, u[_N_INPUTS:-1]) @ self._drift.N.T
        self._psi = following
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
