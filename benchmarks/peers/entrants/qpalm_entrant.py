"""QPALM, a proximal augmented Lagrangian method: Hermans, Themelis and Patrinos, 2022."""

import numpy as np
import qpalm

from benchmarks.peers.entrants.stacked import Stacked, every_entry
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class QpalmEntrant:
    """Warm from solve to solve."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, Stacked(program)
        data = qpalm.Data(program.size, len(self._rows.low))
        data.Q, data.q, data.A = every_entry(program.P), program.q, self._rows.A
        data.bmin, data.bmax = self._rows.low, self._rows.high
        settings = qpalm.Settings()
        settings.eps_abs, settings.eps_rel = tolerance, 0.0
        settings.verbose = False
        self._data, self._solver = data, qpalm.Solver(data, settings)
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def renew(self) -> bool:
        self._rows.renew()
        # What it keeps of a symmetric matrix is the upper half.
        upper_half = self._program.P.T[np.tril_indices(self._program.size)]
        self._solver.update_Q_A(upper_half, self._rows.A.data)
        return True

    def solve(self) -> SolveStatus:
        self._rows.aim()
        self._solver.update_q(self._program.q)
        self._solver.update_bounds(self._rows.low, self._rows.high)
        if self.iterations:
            self._solver.warm_start(self._solver.solution.x, self._solver.solution.y)
        self._solver.solve()
        self.iterations = self._solver.info.iter
        if self._solver.info.status_val != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = self._solver.solution.x
        return SolveStatus.SOLVED
