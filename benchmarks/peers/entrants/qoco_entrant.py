"""QOCO, an interior-point method for second-order cone programs: Chari and Açıkmeşe, 2025."""

import numpy as np
import qoco
from scipy.sparse import csc_matrix

from benchmarks.peers.entrants.one_sided import OneSided
from benchmarks.peers.entrants.stacked import upper_triangle
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class QocoEntrant:
    """Set up once, vectors replaced at every solve; it knows no warm start."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, OneSided(program)
        rows, n = len(self._rows.d), program.size
        self._solver = qoco.QOCO()
        self._solver.setup(
            n,
            rows,
            0,
            upper_triangle(program.P),
            program.q,
            None,
            None,
            csc_matrix(self._rows.C),
            self._rows.d,
            rows,
            0,
            None,
            abstol=tolerance,
            reltol=tolerance,
        )
        self.solution = np.zeros(n)
        self.iterations = 0

    def renew(self) -> bool:
        if self._program.renews_hessian:
            self._solver.update_matrix_data(P=upper_triangle(self._program.P).data)
        if self._program.renews_rows:
            self._rows.renew()
            self._solver.update_matrix_data(G=self._rows.C.data)
        return True

    def solve(self) -> SolveStatus:
        self._rows.aim()
        self._solver.update_vector_data(c=self._program.q, h=self._rows.d)
        result = self._solver.solve()
        self.iterations = result.iters
        if result.status not in ("QOCO_SOLVED", "QOCO_SOLVED_INACCURATE"):
            return SolveStatus.NUMERICS
        self.solution[:] = result.x
        return SolveStatus.SOLVED
