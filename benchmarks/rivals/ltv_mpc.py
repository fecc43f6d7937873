"""The controller of this project with the fitted bicycle in place of a learned model.

Course cost, horizon, knots, input limits, pedals, compensation of the delay, estimator and QP are
those of `Mpc`. `BicycleMpc` linearises along the last plan and solves one QP a period (linear
time-varying MPC).
"""

from typing import Any

import numpy as np

from benchmarks.rivals.bicycle import Bicycle
from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, N_STATES, ControlInput
from rt_controller.control.estimator import MOTION_GAIN, Estimator
from rt_controller.control.mpc import MOST_UNDER_WAY, Mpc
from rt_controller.model.bundle import Bundle


class BicycleLinearisation:
    """The attributes and methods of `Linearisation`, of the bicycle."""

    is_linear = False

    def __init__(self, bicycle: Bicycle, horizon: int) -> None:
        self._bicycle = bicycle
        self.psi = np.zeros((horizon + 1, N_STATES))
        self._derivatives = np.zeros((horizon, N_STATES, N_STATES + N_INPUTS + 1))

    def update(self, psi_0: Array, u: Array, kappa: float) -> None:
        """As `Linearisation.update`."""
        self.psi[:] = self._bicycle.predict(psi_0, u, kappa)
        self._derivatives = self._bicycle.derivatives(self.psi[:-1], u, kappa)

    def times_jacobian(self, y: Array, k: int) -> tuple[Array, Array]:
        """As `Linearisation.times_jacobian`."""
        found = y @ self._derivatives[k]
        return found[:, :N_STATES], found[:, N_STATES:]


def bicycle_estimator(
    bicycle: Bicycle, bundle: Bundle, periods: int = 0, motion_gain: float = MOTION_GAIN
) -> Estimator:
    """The estimator with predictions of the bicycle."""

    def step(psi: Array, applied: ControlInput, curvature_per_m: float) -> Array:
        x = psi.reshape(-1, N_STATES)
        u, w = np.tile(applied, (len(x), 1)), np.full((len(x), 1), curvature_per_m)
        return bicycle.step(x, u, w).reshape(psi.shape)

    return Estimator(bundle, periods, motion_gain, step)


class BicycleMpc(Mpc):
    """Linear time-varying MPC with the bicycle."""

    def __init__(self, bicycle: Bicycle, settings: MpcSettings) -> None:
        bundle = bicycle.bundle()
        super().__init__(bundle, settings.horizon, settings.cost())
        # The product has one linearisation only, so its type provides for no other one.
        of_bicycle: Any = BicycleLinearisation(bicycle, settings.horizon)
        self._qp.linearisation = of_bicycle
        self._estimator = bicycle_estimator(
            bicycle, bundle, settings.horizon + MOST_UNDER_WAY, settings.disturbance_gain
        )

    @property
    def lifted(self) -> Any:
        """None: the checks of the motion use learned models only."""
        return None
