"""The compared solvers: name, package and wrapper.

Solvers that keep their workspace have a wrapper of their own; qpsolvers sets up the others anew for
each problem. Each library is imported when its solver is opened, so any of them may be missing.
"""

from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import hint
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.warm_start import open_solver

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
DEFAULT, COLD = "PIQP, warm", "PIQP"


def one_sided_problem(program: QuadraticProgram, is_sparse: bool = False) -> Any:
    """The program for qpsolvers: every finite bound is a row of G x <= h."""
    import qpsolvers

    rows = np.vstack([np.eye(program.size), program.G])
    G, h = np.vstack([rows, -rows]), np.concatenate([program.all_upper, -program.all_lower])
    is_bound = np.isfinite(h)
    P, G, h = program.P, G[is_bound], h[is_bound]
    if is_sparse:
        return qpsolvers.Problem(csc_matrix(P), program.q, csc_matrix(G), h)
    return qpsolvers.Problem(P, program.q, G, h)


class ColdSolver:
    """A solver of qpsolvers that begins at the last solution if it can."""

    def __init__(self, program: QuadraticProgram, solver: str, options: dict[str, Any]) -> None:
        self._program, self._solver, self._options = program, solver, options
        self.solution = np.zeros(program.size)

    def update_matrices(self) -> bool:
        return True

    def solve(self) -> SolveStatus:
        import qpsolvers

        problem = one_sided_problem(self._program, self._solver != "quadprog")
        found = qpsolvers.solve_problem(
            problem, self._solver, initvals=self.solution, **self._options
        )
        if not found.found:
            return SolveStatus.NUMERICS
        self.solution = found.x
        return SolveStatus.SOLVED


class OsqpSolver:
    """OSQP, an operator splitting method, warm-started: Stellato et al., 2020."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        import osqp

        self._program, n = program, program.size
        self._pattern = np.vstack([np.eye(n, dtype=bool), program.pattern])
        self._upper = np.tril_indices(n)  # of P transposed: its upper half in compressed columns
        columns = np.concatenate([np.arange(column + 1) for column in range(n)])
        starts = np.cumsum([0, *range(1, n + 1)])
        P = csc_matrix((program.P.T[self._upper], columns, starts), shape=(n, n))
        A = csc_matrix(self._pattern, dtype=float)
        A.data[:] = self._rows()
        self.solution = np.zeros(n)
        self._solver = osqp.OSQP()
        self._solver.setup(
            *(P, program.q, A, *program.bounds),
            verbose=False,
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=20_000,
            warm_starting=True,
        )

    def _rows(self) -> Array:
        A = np.vstack([np.eye(self._program.size), self._program.G])
        return np.asarray(A.T[self._pattern.T])

    def update_matrices(self) -> bool:
        Px = self._program.P.T[self._upper] if self._program.hessian_varies else None
        self._solver.update(Px=Px, Ax=self._rows() if self._program.rows_vary else None)
        return True

    def solve(self) -> SolveStatus:
        low, high = self._program.bounds
        self._solver.update(q=self._program.q, l=low, u=high)
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


class QpoasesSolver:
    """qpOASES inside CasADi, an online active-set strategy, warm-started: Ferreau et al., 2014."""

    def __init__(self, program: QuadraticProgram, _: float) -> None:
        import casadi

        n, rows = program.size, len(program.G)
        shape = {"h": casadi.Sparsity.dense(n, n), "a": casadi.Sparsity.dense(rows, n)}
        options: dict[str, Any] = {"printLevel": "none", "sparse": False, "error_on_fail": False}
        function = casadi.conic("peer", "qpoases", shape, options)
        self._buffer: Any
        self._buffer, self._run = function.buffer()
        self._program, self._bounds = program, program.bounds.copy()
        self._columns, self.solution = np.zeros(rows * n), np.zeros(n)
        low, high = self._bounds
        arguments = {"h": program.P, "g": program.q, "a": self._columns}
        arguments |= {"lbx": low[:n], "ubx": high[:n], "lba": low[n:], "uba": high[n:]}
        for name, memory in arguments.items():
            if memory.size:
                self._buffer.set_arg(function.name_in().index(name), memory.data)
        self._buffer.set_res(function.name_out().index("x"), self.solution.data)
        self.update_matrices()

    def update_matrices(self) -> bool:
        self._columns[:] = self._program.G.ravel(order="F")
        return True

    def solve(self) -> SolveStatus:
        self._bounds[:] = self._program.bounds
        self._run()
        return SolveStatus.SOLVED if self._buffer.ret() == 0 else SolveStatus.NUMERICS


class SolverEntry(NamedTuple):
    """A solver that can be opened on a program."""

    name: str
    package: str
    """whose version is reported"""
    open: Callable[[QuadraticProgram, float], Any]
    """on a program, with a tolerance: a solver with the methods of `Solver` that are compared"""
    has_tolerance: bool = True
    """False: the tolerance is ignored"""


def _cold(name: str, package: str, *tolerances: str, **more: Any) -> SolverEntry:
    """`tolerances` are the names of its options that get the tolerance, `more` has others."""

    def open_cold(program: QuadraticProgram, tolerance: float) -> ColdSolver:
        return ColdSolver(program, package, {**dict.fromkeys(tolerances, tolerance), **more})

    return SolverEntry(name, package, open_cold, bool(tolerances))


OWN = (
    SolverEntry(DEFAULT, "piqp", lambda program, _: open_solver(program), False),
    SolverEntry(COLD, "piqp", lambda program, _: open_solver(program, warm_start=False), False),
)
PEERS = (
    SolverEntry("OSQP", "osqp", OsqpSolver),
    SolverEntry("ProxQP", "proxsuite", ProxqpSolver),
    SolverEntry("qpOASES (CasADi)", "casadi", QpoasesSolver, False),
    _cold("QPALM", "qpalm", "eps_abs", eps_rel=0.0),
    _cold("SCS", "scs", "eps_abs", eps_rel=0.0),
    _cold("Clarabel", "clarabel", "tol_gap_abs", "tol_gap_rel", "tol_feas", max_threads=1),
    _cold("quadprog", "quadprog"),
)


def find_solvers(only: Sequence[str] = ()) -> tuple[list[SolverEntry], list[str]]:
    """The requested solvers that are installed, the controller's own first; names of the others.

    Raises:
        ConfigError: a name is not one of a solver.
    """
    names = [entry.name for entry in (*OWN, *PEERS)]
    if unknown := next((name for name in only if name not in names), None):
        raise ConfigError(
            f"--only {unknown!r}: expected one of {'; '.join(names)}{hint(unknown, names)}."
        )
    requested = [entry for entry in PEERS if not only or entry.name in only]
    installed = [entry for entry in requested if find_spec(entry.package) is not None]
    return [*OWN, *installed], [entry.name for entry in requested if entry not in installed]
