"""quadprog, the dual active-set method of Goldfarb and Idnani, 1983."""

import numpy as np
import quadprog

from benchmarks.peers.entrants.one_sided import OneSided
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class QuadprogEntrant:
    """Exact and cold: only the factor of P is kept. `tolerance` is nothing to it."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, OneSided(program)
        self.renew()
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def renew(self) -> bool:
        self._rows.renew()
        self._C = np.ascontiguousarray(-self._rows.C.toarray().T)
        R = np.linalg.cholesky(self._program.P).T
        self._inverse_factor = np.linalg.inv(R)
        return True

    def solve(self) -> SolveStatus:
        self._rows.aim()
        try:
            x, _, _, iterations, _, _ = quadprog.solve_qp(
                self._inverse_factor,
                -self._program.q,
                self._C,
                -self._rows.d,
                0,
                factorized=True,
            )
        except ValueError:
            return SolveStatus.INFEASIBLE
        self.iterations = int(iterations[0])
        self.solution[:] = x
        return SolveStatus.SOLVED
