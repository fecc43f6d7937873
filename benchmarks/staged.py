"""Eq. (14) as the paper writes it: the lifted states are variables, and the QP is sparse.

Compared with the controller's condensed QP in `benchmarks.growth`; decision 018.
"""

from typing import cast

import numpy as np
from scipy.sparse import csc_matrix, diags, identity, kron, triu, vstack

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.schema import N_INPUTS, N_STATES
from rt_controller.control.mpc import Mpc
from rt_controller.control.pedals import PedalChoice, limit_pedals
from rt_controller.control.piqp_solver import open_workspace, solve_workspace
from rt_controller.control.program import QpParameters
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import Solver, SolveStatus
from rt_controller.control.terms import TrackingCost, constrain_inputs, cost_terms


class StagedQp:
    """Eq. (14) with slew rates, over z = [v_0, psi_1, v_1, psi_2, …], for a constant input matrix.

    minimise 1/2 z' P z + q' z subject to M z = b, row_lower <= G z <= row_upper and bounds on the
    inputs v, in units of their ranges. A period changes vectors only.

    Paper: eq. (14).
    """

    matrices_vary = False

    def __init__(self, bundle: Bundle, horizon: int, cost: TrackingCost) -> None:
        inputs = constrain_inputs(horizon)
        terms = cost_terms(cost, inputs, bundle.n_observables - N_STATES)
        self.parameters = QpParameters(bundle.n_observables, horizon, terms.stage.size)
        self.scale = inputs.scale
        self._bundle = bundle
        n, m, p = bundle.n_observables, N_INPUTS, terms.stage.size
        size = horizon * (m + n)
        indices = np.arange(size).reshape(horizon, m + n)
        inputs_only = csc_matrix(identity(size))[indices[:, :m].reshape(-1)]

        on_states = np.zeros((horizon, m + n))
        on_states[:, m : m + p] = terms.output_weights().reshape(horizon, p)
        self._from_previous = terms.from_previous
        self._output_weights = on_states[:, m : m + p]
        P_inputs = inputs_only.T @ csc_matrix(terms.H) @ inputs_only
        self.P = csc_matrix(P_inputs + diags(on_states.reshape(-1)))
        self.q = np.zeros(size)
        q = self.q.reshape(horizon, m + n)
        self._q_of_first_input, self._q_of_outputs = q[0, :m], q[:, m : m + p]

        self.M = _dynamics(bundle, inputs.scale[:m], horizon)
        self.b = np.zeros(horizon * n)
        self.G = csc_matrix(inputs.D) @ inputs_only
        self.row_upper, self._slew = inputs.slew, inputs.slew[:m].copy()
        self.row_lower = -inputs.slew
        self.lower, self.upper = np.full(size, -np.inf), np.full(size, np.inf)
        self.lower[indices[:, :m]] = inputs.lower.reshape(horizon, m)
        self._upper = self.upper.reshape(horizon, m + n)[:, :m]
        self._upper[:] = inputs.upper.reshape(horizon, m)

    def update_vectors(self, pedals: PedalChoice) -> None:
        now, bundle, m = self.parameters, self._bundle, N_INPUTS
        np.multiply(-self._output_weights, now.reference, out=self._q_of_outputs)
        np.multiply(self._from_previous, now.previous, out=self._q_of_first_input)
        b = self.b.reshape(-1, bundle.n_observables)
        b[:] = bundle.c + bundle.B_uw[:, 0] * now.curvature_per_m
        b[0] += bundle.A @ now.psi
        v_prev = now.previous / self.scale[:m]
        np.subtract(v_prev, self._slew, out=self.row_lower[:m])
        np.add(v_prev, self._slew, out=self.row_upper[:m])
        limit_pedals(self._upper, pedals, v_prev, self._slew)

    def inputs_of(self, z: Array) -> Array:
        """v_0 … v_(N-1) (nv,) of a solution."""
        inputs: Array = z.reshape(len(self._upper), -1)[:, :N_INPUTS].reshape(-1)
        return inputs


def _dynamics(bundle: Bundle, scale: Array, horizon: int) -> csc_matrix:
    """M: psi_(k+1) - A psi_k - B v_k over the stages."""
    n = bundle.n_observables
    present = np.hstack([-bundle.B_uc * scale, np.eye(n)])
    last = np.hstack([np.zeros((n, N_INPUTS)), -bundle.A])
    shift = diags([1.0], [-1], shape=(horizon, horizon))
    return csc_matrix(kron(identity(horizon), present) + kron(shift, last))


MAX_ITERATIONS = 30
"""more than with inputs only: states have many units and no bounds"""
OSQP_TOLERANCE = 1e-6
"""the loosest power of ten with which first inputs are exact to 1e-4 of their range"""


class _StagedSolver:
    """What both solvers share: constant matrices, and a solution (nv,) of inputs only."""

    def __init__(self, qp: StagedQp) -> None:
        self._qp = qp
        self.solution = np.zeros(qp.scale.size)
        self.iterations = 0

    def limit_solve_time(self, budget_ns: int) -> int:
        """Do nothing: the time is measured, not limited."""
        return 0

    def update_matrices(self) -> bool:
        return True


class StagedPiqp(_StagedSolver):
    """PIQP, whose factorisation goes from stage to stage."""

    def __init__(self, qp: StagedQp) -> None:
        super().__init__(qp)
        self._workspace = open_workspace(MAX_ITERATIONS)
        rows = (qp.G, qp.row_lower, qp.row_upper)
        self._workspace.setup(qp.P, qp.q, qp.M, qp.b, *rows, qp.lower, qp.upper)

    def solve(self) -> SolveStatus:
        qp = self._qp
        self._workspace.update(c=qp.q, b=qp.b, h_l=qp.row_lower, h_u=qp.row_upper, x_u=qp.upper)
        status = solve_workspace(self._workspace)
        self.iterations = self._workspace.result.info.iter
        if status is SolveStatus.SOLVED:
            self.solution[:] = qp.inputs_of(self._workspace.result.x)
        return status


class StagedOsqp(_StagedSolver):
    """OSQP without a warm start."""

    def __init__(self, qp: StagedQp) -> None:
        import osqp

        super().__init__(qp)
        self._solver = osqp.OSQP()
        self._solver.setup(
            csc_matrix(triu(qp.P)),
            qp.q,
            csc_matrix(vstack([qp.M, qp.G, identity(qp.q.size)])),
            *self._bounds(),
            verbose=False,
            eps_abs=OSQP_TOLERANCE,
            eps_rel=OSQP_TOLERANCE,
            max_iter=20_000,
            warm_starting=False,
        )

    def solve(self) -> SolveStatus:
        low, high = self._bounds()
        self._solver.update(q=self._qp.q, l=low, u=high)
        result = self._solver.solve(raise_error=False)
        self.iterations = result.info.iter
        if result.info.status_val != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = self._qp.inputs_of(result.x)
        return SolveStatus.SOLVED

    def _bounds(self) -> tuple[Array, Array]:
        qp = self._qp
        low = np.concatenate([qp.b, qp.row_lower, qp.lower])
        return low, np.concatenate([qp.b, qp.row_upper, qp.upper])


def use_staged_qp(mpc: Mpc, qp: StagedQp, solver: Solver) -> Mpc:
    """The same controller with this QP, and its solver, in place of the condensed one."""
    mpc._qp, mpc._solver = cast("CondensedQp", qp), solver
    return mpc
