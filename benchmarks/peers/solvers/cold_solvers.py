"""Solvers without a warm start: set up for each problem by qpsolvers, and QOCO by itself."""

from typing import Any

import numpy as np
import qpsolvers

from benchmarks.peers.solvers.rows import OneSidedRows, upper_triangle
from rt_controller.control.program import QuadraticProgram, SolveStatus


class ColdSolver:
    """A solver of qpsolvers; `options` are those of its `solve_problem`."""

    def __init__(self, program: QuadraticProgram, solver: str, **options: Any) -> None:
        self._program, self._rows = program, OneSidedRows(program)
        self._solver, self._options = solver, options
        self.solution = np.zeros(program.size)

    def update_matrices(self) -> bool:
        self._rows.update_matrices()
        return True

    def solve(self) -> SolveStatus:
        self._rows.update_vectors()
        P, q, C, d = self._program.P, self._program.q, self._rows.C, self._rows.d
        if self._solver == "quadprog":  # dense
            C = C.toarray()
        else:
            P = upper_triangle(P)
        found = qpsolvers.solve_problem(
            qpsolvers.Problem(P, q, C, d), self._solver, **self._options
        )
        if not found.found:
            return SolveStatus.NUMERICS
        self.solution[:] = found.x
        return SolveStatus.SOLVED


def open_clarabel(program: QuadraticProgram, tolerance: float) -> ColdSolver:
    """Clarabel, an interior-point method for conic programs: Goulart and Chen, 2024."""
    names = ("tol_gap_abs", "tol_gap_rel", "tol_feas")
    return ColdSolver(program, "clarabel", max_threads=1, **dict.fromkeys(names, tolerance))


def open_quadprog(program: QuadraticProgram, _: float) -> ColdSolver:
    """The dual active-set method of Goldfarb and Idnani, 1983; it has no tolerance."""
    return ColdSolver(program, "quadprog")


class QocoSolver:
    """QOCO, an interior-point method: Chari and Açıkmeşe, 2025."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        import qoco

        self._program, self._rows = program, OneSidedRows(program)
        n, rows = program.size, len(self._rows.d)
        self.solution = np.zeros(n)
        objective = (upper_triangle(program.P), program.q)
        no_equalities = (None, None)
        inequalities = (self._rows.C, self._rows.d, rows)
        no_cones = (0, None)
        problem = (n, rows, 0, *objective, *no_equalities, *inequalities, *no_cones)
        self._solver = qoco.QOCO()
        self._solver.setup(*problem, abstol=tolerance, reltol=tolerance)

    def update_matrices(self) -> bool:
        if self._program.hessian_varies:
            self._solver.update_matrix_data(P=upper_triangle(self._program.P).data)
        if self._program.rows_vary:
            self._rows.update_matrices()
            self._solver.update_matrix_data(G=self._rows.C.data)
        return True

    def solve(self) -> SolveStatus:
        self._rows.update_vectors()
        self._solver.update_vector_data(c=self._program.q, h=self._rows.d)
        result = self._solver.solve()
        if result.status not in ("QOCO_SOLVED", "QOCO_SOLVED_INACCURATE"):
            return SolveStatus.NUMERICS
        self.solution[:] = result.x
        return SolveStatus.SOLVED
