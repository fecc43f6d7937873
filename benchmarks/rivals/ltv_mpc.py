"""The controller of this project with the fitted bicycle in place of a learned model.

Course cost, horizon, knots, input limits, pedals, compensation of the delay, estimator and QP are
those of `Mpc`. `BicycleMpc` linearises along the last plan and solves one QP a period (linear
time-varying MPC); with more iterations it is a nonlinear MPC: a Gauss-Newton SQP, whose QPs are
linearised along the solution of the one before until it stays the same (Diehl, Bock and Schlöder,
2005).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.rivals.bicycle import Bicycle
from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, N_STATES, ControlInput
from rt_controller.control.estimator import MOTION_GAIN, Estimator
from rt_controller.control.linearisation import ALL_INPUTS
from rt_controller.control.mpc import MOST_UNDER_WAY, Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.control.terms import Knots
from rt_controller.model.bundle import Bundle

CONVERGED, MOST_ITERATIONS = 1e-4, 10
"""largest change of an input between two iterations, as a share of its range; QPs in a period"""


class BicycleLinearisation:
    """The attributes and methods of `Linearisation`, of the bicycle."""

    is_linear = False

    def __init__(self, bicycle: Bicycle, knots: Knots, tracked: Sequence[int]) -> None:
        self._bicycle, self._knots, self._tracked = bicycle, knots, tracked
        self._forward = np.zeros((N_STATES, N_STATES + 1 + N_INPUTS * knots.count))
        shape = (knots.count, len(tracked))
        self.observables = np.zeros((knots.horizon + 1, N_STATES))
        self.by_inputs = np.zeros((*shape, N_INPUTS, knots.count))
        self.by_curvature, self.by_psi = np.zeros(shape), np.zeros((*shape, N_STATES))

    def update(
        self, psi: Array, curvature_per_m: float, inputs: Array, used: slice = ALL_INPUTS
    ) -> None:
        """As `Linearisation.update`: derivatives by psi, curvature and knots, stage by stage."""
        bicycle, knots = self._bicycle, self._knots
        self.observables[:] = bicycle.predict(psi, inputs, curvature_per_m)
        derivatives = bicycle.derivatives(self.observables[:-1], inputs, curvature_per_m)
        by_stage = derivatives[:, :, N_STATES : N_STATES + N_INPUTS]
        by_knots = np.einsum("kxu,kj->kxuj", by_stage, knots.interpolation)
        S = self._forward
        S[:] = np.eye(N_STATES, S.shape[1])
        at_end = {end: number for number, end in enumerate(knots.ends)}
        for k, each in enumerate(derivatives):
            S[:] = each[:, :N_STATES] @ S
            S[:, N_STATES] += each[:, -1]
            S[:, N_STATES + 1 :] += by_knots[k].reshape(N_STATES, -1)
            number = at_end.get(k + 1)
            if number is not None:
                rows = S[self._tracked]
                self.by_psi[number] = rows[:, :N_STATES]
                self.by_curvature[number] = rows[:, N_STATES]
                of_inputs = rows[:, N_STATES + 1 :].reshape(len(rows), N_INPUTS, -1)
                self.by_inputs[number] = 0.0
                self.by_inputs[number][:, used] = of_inputs[:, used]


class BicycleEstimator(Estimator):
    """The estimator with predictions of the bicycle."""

    def __init__(
        self, bicycle: Bicycle, bundle: Bundle, periods: int = 0, motion_gain: float = MOTION_GAIN
    ) -> None:
        super().__init__(bundle, periods, motion_gain)
        self._bicycle = bicycle

    def step(self, psi: Array, applied: ControlInput, curvature_per_m: float) -> Array:
        x = psi.reshape(-1, N_STATES)
        u, w = np.tile(applied, (len(x), 1)), np.full((len(x), 1), curvature_per_m)
        return self._bicycle.step(x, u, w).reshape(psi.shape)


class BicycleMpc(Mpc):
    """Linear time-varying MPC with the bicycle; nonlinear MPC if `is_iterated`."""

    def __init__(self, bicycle: Bicycle, settings: MpcSettings, is_iterated: bool = False) -> None:
        bundle = bicycle.bundle()
        super().__init__(bundle, settings.horizon, settings.cost())
        objective, knots = self._qp.objective, self._qp.knots
        # The product has one linearisation only, so its type provides for no other one.
        of_bicycle: Any = BicycleLinearisation(bicycle, knots, objective._columns)
        objective._linearisation = of_bicycle
        self._estimator = BicycleEstimator(
            bicycle, bundle, settings.horizon + MOST_UNDER_WAY, settings.disturbance_gain
        )
        self._iterations_left = MOST_ITERATIONS - 1 if is_iterated else 0

    def plan(self, *arguments: Any) -> SolveStatus:
        status = super().plan(*arguments)
        parameters, qp, solver = self._qp.parameters, self._qp, self._solver
        for _ in range(self._iterations_left):
            if status is not SolveStatus.SOLVED:
                break
            before = solver.solution.copy()
            knots = (before[: qp.scale.size] * qp.scale).reshape(-1, N_INPUTS)
            parameters.nominal_knots[:], parameters.nominal_inputs[:] = knots, self.inputs
            qp.update_matrices(self._pedals.used_inputs(parameters.previous))
            solver.update_matrices()
            qp.update_vectors(self._pedals)
            status = solver.solve()
            self._has_plan = status is SolveStatus.SOLVED
            if self._has_plan:
                knots = (solver.solution[: qp.scale.size] * qp.scale).reshape(-1, N_INPUTS)
                np.dot(qp.interpolation, knots, out=self.inputs)
                if np.abs(solver.solution - before).max() < CONVERGED:
                    break
        return status

    @property
    def lifted(self) -> Any:
        """None: the checks of the motion use learned models only."""
        return None
