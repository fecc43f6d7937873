"""The paper's own QP: every lifted state a variable, a generic solver that begins anew."""

import numpy as np
import osqp
from scipy.sparse import csc_matrix, identity, triu, vstack

from rt_controller.control.solver import SolveStatus
from rt_controller.control.staged_qp import StagedQp

TOLERANCE = 1e-5


class OsqpOnStages:
    """`Solver` on the QP with states, by OSQP without a warm start."""

    def __init__(self, qp: StagedQp) -> None:
        self._qp = qp
        self._solver = osqp.OSQP()
        rows = csc_matrix(vstack([qp.M, qp.G, identity(qp.q.size)]))
        self._solver.setup(
            csc_matrix(triu(qp.P)),
            qp.q,
            rows,
            *self._bounds(),
            verbose=False,
            eps_abs=TOLERANCE,
            eps_rel=TOLERANCE,
            max_iter=20_000,
            warm_starting=False,
        )
        self.solution = np.zeros(qp.scale.size)
        self.iterations = 0

    def bound(self, budget_ns: int) -> None:
        """Nothing: it takes what it takes."""

    def renew(self) -> bool:
        """Nothing: the matrices are constant."""
        return True

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        low, high = self._bounds()
        self._solver.update(q=self._qp.q, l=low, u=high)
        result = self._solver.solve(raise_error=False)
        self.iterations = result.info.iter
        if result.info.status_val != 1:
            return SolveStatus.ITERATION_LIMIT
        self._qp.read(result.x, self.solution)
        return SolveStatus.SOLVED

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        qp = self._qp
        low = np.concatenate([qp.b, qp.row_lower, qp.lower])
        return low, np.concatenate([qp.b, qp.row_upper, qp.upper])
