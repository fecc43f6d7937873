"""Solvers that keep their workspace and start from the last solution.

Each class imports its library when it is opened, so that any of them may be missing.
"""

from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from benchmarks.peers.solvers.rows import OneSidedRows, TwoSidedRows, upper_triangle
from rt_controller.control.program import QuadraticProgram, SolveStatus


class OsqpSolver:
    """OSQP, an operator splitting method, warm-started: Stellato et al., 2020."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        import osqp

        self._program, self._rows = program, TwoSidedRows(program)
        self.solution = np.zeros(program.size)
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

    def update_matrices(self) -> bool:
        self._rows.update_matrices()
        Px = upper_triangle(self._program.P).data if self._program.hessian_varies else None
        self._solver.update(Px=Px, Ax=self._rows.A.data if self._program.rows_vary else None)
        return True

    def solve(self) -> SolveStatus:
        self._rows.update_vectors()
        self._solver.update(q=self._program.q, l=self._rows.low, u=self._rows.high)
        result = self._solver.solve(raise_error=False)
        if result.info.status_val != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = result.x
        return SolveStatus.SOLVED


class ProxqpSolver:
    """ProxQP, a proximal augmented Lagrangian method, warm-started: Bambade et al., 2022."""

    MAX_OUTER_ITERATIONS = 100
    """a dozen are typical; with soft bounds near the limit of grip it may not converge"""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        from proxsuite import proxqp

        self._program, self._solved = program, proxqp.PROXQP_SOLVED
        self.solution = np.zeros(program.size)
        self._qp = qp = proxqp.dense.QP(program.size, 0, len(program.G), True)
        qp.settings.eps_abs, qp.settings.eps_rel = tolerance, 0.0
        qp.settings.max_iter = self.MAX_OUTER_ITERATIONS
        qp.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        rows = (program.G, program.row_lower, program.row_upper) if len(program.G) else (None,) * 3
        qp.init(program.P, program.q, None, None, *rows, program.lower, program.upper)
        qp.solve()  # an update before the first solve crashes the process

    def update_matrices(self) -> bool:
        H = self._program.P if self._program.hessian_varies else None
        self._qp.update(H=H, C=self._program.G if self._program.rows_vary else None)
        return True

    def solve(self) -> SolveStatus:
        program = self._program
        bounds = {"l_box": program.lower, "u_box": program.upper}
        if len(program.G):
            bounds |= {"l": program.row_lower, "u": program.row_upper}
        self._qp.update(g=program.q, **bounds)
        self._qp.solve()
        if self._qp.results.info.status != self._solved:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = self._qp.results.x
        return SolveStatus.SOLVED


class QpalmSolver:
    """QPALM, a proximal augmented Lagrangian method, warm-started: Hermans et al., 2022."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        import qpalm

        self._program, self._rows = program, TwoSidedRows(program)
        self.solution = np.zeros(program.size)
        n = program.size
        # All entries of P, zeros too: a later P may have other values there.
        P = (program.P.reshape(-1).copy(), np.tile(np.arange(n), n), np.arange(0, n * n + 1, n))
        self._data = data = qpalm.Data(n, len(self._rows.low))
        data.Q, data.q, data.A = csc_matrix(P, shape=(n, n)), program.q, self._rows.A
        data.bmin, data.bmax = self._rows.low, self._rows.high
        settings = qpalm.Settings()
        settings.eps_abs, settings.eps_rel, settings.verbose = tolerance, 0.0, False
        self._solver = qpalm.Solver(data, settings)
        self._is_warm = False

    def update_matrices(self) -> bool:
        self._rows.update_matrices()
        # It stores the upper half of a symmetric matrix.
        self._solver.update_Q_A(upper_triangle(self._program.P).data, self._rows.A.data)
        return True

    def solve(self) -> SolveStatus:
        self._rows.update_vectors()
        self._solver.update_q(self._program.q)
        self._solver.update_bounds(self._rows.low, self._rows.high)
        if self._is_warm:
            self._solver.warm_start(self._solver.solution.x, self._solver.solution.y)
        self._solver.solve()
        self._is_warm = True
        if self._solver.info.status_val != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = self._solver.solution.x
        return SolveStatus.SOLVED


class ScsSolver:
    """SCS, a splitting conic solver, warm-started: O'Donoghue, 2021."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, OneSidedRows(program)
        self._tolerance = tolerance
        self._last: dict[str, Any] = {}
        self.solution = np.zeros(program.size)
        self.update_matrices()

    def update_matrices(self) -> bool:
        """New matrices need a new workspace."""
        import scs

        program, rows = self._program, self._rows
        rows.update_matrices()
        P = csc_matrix(np.triu(program.P))
        data = {"P": P, "A": rows.C, "b": rows.d, "c": program.q}
        cone = {"l": len(rows.d)}
        self._solver = scs.SCS(data, cone, eps_abs=self._tolerance, eps_rel=0.0, verbose=False)
        return True

    def solve(self) -> SolveStatus:
        self._rows.update_vectors()
        self._solver.update(b=self._rows.d, c=self._program.q)
        result = self._solver.solve(warm_start=bool(self._last), **self._last)
        self._last = {name: result[name] for name in ("x", "y", "s")}
        if result["info"]["status_val"] != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = result["x"]
        return SolveStatus.SOLVED


class QpoasesSolver:
    """qpOASES inside CasADi, an online active-set strategy, warm-started: Ferreau et al., 2014."""

    def __init__(self, program: QuadraticProgram, _: float) -> None:
        import casadi

        self._program = program
        n, rows = program.size, len(program.G)
        columns, row_indices = np.nonzero(program.pattern.T)
        shape: dict[str, Any] = {
            "h": casadi.Sparsity.dense(n, n),
            "a": casadi.Sparsity.triplet(rows, n, row_indices.tolist(), columns.tolist()),
        }
        options: dict[str, Any] = {"printLevel": "none", "sparse": False, "error_on_fail": False}
        function = casadi.conic("peer", "qpoases", shape, options)
        self._buffer: Any
        self._buffer, self._run = function.buffer()
        self._G = np.zeros(len(columns))
        self._bounds = program.bounds.copy()
        self.solution = np.zeros(n)
        low, high = self._bounds
        arguments = {"h": program.P, "g": program.q, "a": self._G}
        arguments |= {"lbx": low[:n], "ubx": high[:n], "lba": low[n:], "uba": high[n:]}
        for name, memory in arguments.items():
            if memory.size:
                self._buffer.set_arg(function.name_in().index(name), memory.data)
        self._buffer.set_res(function.name_out().index("x"), self.solution.data)
        self.update_matrices()

    def update_matrices(self) -> bool:
        self._G[:] = self._program.G.T[self._program.pattern.T]
        return True

    def solve(self) -> SolveStatus:
        self._bounds[:] = self._program.bounds
        self._run()
        return SolveStatus.SOLVED if self._buffer.ret() == 0 else SolveStatus.NUMERICS
