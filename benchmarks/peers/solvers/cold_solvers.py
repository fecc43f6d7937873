"""Solvers without a warm start, called through their own interfaces.

Each class imports its library when it is opened, so that any of them may be missing.
"""

import numpy as np

from benchmarks.peers.solvers.rows import OneSidedRows, upper_triangle
from rt_controller.control.program import QuadraticProgram, SolveStatus


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


class ClarabelSolver:
    """Clarabel, an interior-point method for conic programs: Goulart and Chen, 2024."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        import clarabel

        self._program, self._rows = program, OneSidedRows(program)
        self.solution = np.zeros(program.size)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        settings.presolve_enable = False  # otherwise it refuses new data
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        objective = (upper_triangle(program.P), program.q)
        cones = [clarabel.NonnegativeConeT(len(self._rows.d))]
        self._solver = clarabel.DefaultSolver(
            *objective, self._rows.C, self._rows.d, cones, settings
        )
        self._usable = (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved)

    def update_matrices(self) -> bool:
        if self._program.hessian_varies:
            self._solver.update(P=upper_triangle(self._program.P).data)
        if self._program.rows_vary:
            self._rows.update_matrices()
            self._solver.update(A=self._rows.C.data)
        return True

    def solve(self) -> SolveStatus:
        self._rows.update_vectors()
        self._solver.update(q=self._program.q, b=self._rows.d)
        result = self._solver.solve()
        if result.status not in self._usable:
            return SolveStatus.NUMERICS
        self.solution[:] = result.x
        return SolveStatus.SOLVED


class QuadprogSolver:
    """The dual active-set method of Goldfarb and Idnani, 1983; it has no tolerance.

    It keeps no workspace; the inverse factor of P is computed in `update_matrices`.
    """

    def __init__(self, program: QuadraticProgram, _: float) -> None:
        self._program, self._rows = program, OneSidedRows(program)
        self.solution = np.zeros(program.size)
        self.update_matrices()

    def update_matrices(self) -> bool:
        self._rows.update_matrices()
        self._C = np.ascontiguousarray(-self._rows.C.toarray().T)
        self._inverse_factor = np.linalg.inv(np.linalg.cholesky(self._program.P).T)
        return True

    def solve(self) -> SolveStatus:
        import quadprog

        self._rows.update_vectors()
        problem = (self._inverse_factor, -self._program.q, self._C, -self._rows.d)
        try:
            x, *_ = quadprog.solve_qp(*problem, factorized=True)
        except ValueError:  # constraints that it finds inconsistent
            return SolveStatus.NUMERICS
        self.solution[:] = x
        return SolveStatus.SOLVED
