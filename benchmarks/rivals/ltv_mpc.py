"""The controller of this project with the fitted bicycle in place of a learned model.

Course cost, horizon, knots, input limits, pedals, compensation of the delay, estimator and QP are
those of `Mpc`. `BicycleMpc` linearises along the last plan and solves one QP a period (linear
time-varying MPC); with more iterations it is a nonlinear MPC: a Gauss-Newton SQP, whose QPs are
linearised along the solution of the one before until it stays the same (Diehl, Bock and Schlöder,
2005).
"""

from typing import Any

import numpy as np

from benchmarks.rivals.bicycle import Bicycle
from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, N_STATES, ControlInput
from rt_controller.control.estimator import MOTION_GAIN, Estimator
from rt_controller.control.mpc import MOST_UNDER_WAY, Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle

CONVERGED, MOST_ITERATIONS = 1e-4, 10
"""largest change of an input between two iterations, as a share of its range; QPs in a period"""


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
    """Linear time-varying MPC with the bicycle; nonlinear MPC if `is_iterated`."""

    def __init__(self, bicycle: Bicycle, settings: MpcSettings, is_iterated: bool = False) -> None:
        bundle = bicycle.bundle()
        super().__init__(bundle, settings.horizon, settings.cost())
        # The product has one linearisation only, so its type provides for no other one.
        of_bicycle: Any = BicycleLinearisation(bicycle, settings.horizon)
        self._qp.linearisation = of_bicycle
        self._estimator = bicycle_estimator(
            bicycle, bundle, settings.horizon + MOST_UNDER_WAY, settings.disturbance_gain
        )
        self._iterations_left = MOST_ITERATIONS - 1 if is_iterated else 0

    def plan(self, *arguments: Any) -> SolveStatus:
        status = super().plan(*arguments)
        qp, solver = self._qp, self._solver
        for _ in range(self._iterations_left):
            if status is not SolveStatus.SOLVED:
                break
            before = solver.solution.copy()
            qp.u_nominal[:] = (before * qp.scale).reshape(-1, N_INPUTS)
            qp.update_matrices()
            solver.update_matrices()
            qp.update_vectors()
            status = solver.solve()
            self._has_plan = status is SolveStatus.SOLVED
            if self._has_plan:
                np.dot(qp.T, (solver.solution * qp.scale).reshape(-1, N_INPUTS), out=self.inputs)
                if np.abs(solver.solution - before).max() < CONVERGED:
                    break
        return status

    @property
    def lifted(self) -> Any:
        """None: the checks of the motion use learned models only."""
        return None
