"""PIQP on the QP with states: its factorisation goes from stage to stage."""

import numpy as np

from rt_controller.control.piqp_workspace import PiqpWorkspace
from rt_controller.control.solver import SolveStatus
from rt_controller.control.staged_qp import StagedQp

MAX_ITERATIONS = 30
"""states are of many units and without bounds: that takes more of them than inputs alone"""
LEAST_ITERATIONS = 20


class StagedSolver:
    """`Solver`, whose solution (nv,) are the inputs.

    Raises:
        ConfigError: the program is not a convex QP.
    """

    def __init__(self, qp: StagedQp, max_iterations: int = MAX_ITERATIONS) -> None:
        self._qp = qp
        self._has_rows = qp.row_upper.size > 0
        self._workspace = PiqpWorkspace(max_iterations, LEAST_ITERATIONS)
        self.solution = np.zeros(qp.scale.size)
        self.iterations = 0
        rows = (qp.G, qp.row_lower, qp.row_upper) if self._has_rows else (None, None, None)
        self._workspace.solver.setup(qp.P, qp.q, qp.M, qp.b, *rows, qp.lower, qp.upper)
        self._workspace.try_once()

    def bound(self, budget_ns: int) -> None:
        """As `Solver.bound`."""
        self._workspace.bound(budget_ns)

    def renew(self) -> bool:
        """As `Solver.renew`: the matrices are constant."""
        return True

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        qp = self._qp
        self.iterations = 0
        if not np.isfinite(qp.q.sum() + qp.b.sum() + qp.row_lower.sum() + qp.row_upper.sum()):
            return SolveStatus.NUMERICS
        self._workspace.solver.update(
            c=qp.q,
            b=qp.b,
            h_l=qp.row_lower if self._has_rows else None,
            h_u=qp.row_upper if self._has_rows else None,
            x_u=qp.upper,
        )
        status = self._workspace.run()
        self.iterations = self._workspace.iterations
        if status is SolveStatus.SOLVED:
            if not np.isfinite(self._workspace.x).all():
                return SolveStatus.NUMERICS
            qp.read(self._workspace.x, self.solution)
        return status
