"""Clarabel, an interior-point method for conic programs: Goulart and Chen, 2024."""

import clarabel
import numpy as np

from benchmarks.peers.entrants.one_sided import OneSided
from benchmarks.peers.entrants.stacked import upper_triangle
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class ClarabelEntrant:
    """Set up once, vectors replaced at every solve; it knows no warm start."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, OneSided(program)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.presolve_enable = False  # else nothing may be replaced
        settings.max_threads = 1
        for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            setattr(settings, name, tolerance)
        self._solver = clarabel.DefaultSolver(
            upper_triangle(program.P),
            program.q,
            self._rows.C,
            self._rows.d,
            [clarabel.NonnegativeConeT(len(self._rows.d))],
            settings,
        )
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def renew(self) -> bool:
        if self._program.renews_hessian:
            self._solver.update(P=upper_triangle(self._program.P))
        if self._program.renews_rows:
            self._rows.renew()
            self._solver.update(A=self._rows.C)
        return True

    def solve(self) -> SolveStatus:
        self._rows.aim()
        self._solver.update(q=self._program.q, b=self._rows.d)
        result = self._solver.solve()
        self.iterations = result.iterations
        if str(result.status) not in ("Solved", "AlmostSolved"):
            return SolveStatus.NUMERICS
        self.solution[:] = result.x
        return SolveStatus.SOLVED
