"""OSQP, an operator splitting method: Stellato et al., 2020."""

import numpy as np
import osqp

from benchmarks.peers.entrants.stacked import Stacked, upper_triangle
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class OsqpEntrant:
    """Warm from solve to solve, its factorisation kept."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, Stacked(program)
        self._solver = osqp.OSQP()
        self._solver.setup(
            upper_triangle(program.P),
            program.q,
            self._rows.A,
            self._rows.low,
            self._rows.high,
            verbose=False,
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=20_000,
            warm_starting=True,
        )
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def renew(self) -> bool:
        self._rows.renew()
        program = self._program
        self._solver.update(
            Px=program.P.T[np.tril_indices(program.size)] if program.renews_hessian else None,
            Ax=self._rows.A.data if program.renews_rows else None,
        )
        return True

    def solve(self) -> SolveStatus:
        self._rows.aim()
        self._solver.update(q=self._program.q, l=self._rows.low, u=self._rows.high)
        result = self._solver.solve(raise_error=False)
        self.iterations = result.info.iter
        if result.info.status_val != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = result.x
        return SolveStatus.SOLVED
