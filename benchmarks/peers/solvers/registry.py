"""Registry of the compared solvers: name, package and wrapper."""

from collections.abc import Callable, Sequence
from importlib import metadata
from importlib.util import find_spec
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import csc_matrix

from benchmarks.peers.solvers import warm_solvers
from benchmarks.peers.solvers.rows import OneSidedRows
from rt_controller.contract.arrays import Array
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus, open_solver


class ColdSolver:
    """A solver of qpsolvers without a warm start: each solve includes the set-up of the solver.

    Matrices are converted to its format in `update_matrices`.
    """

    def __init__(
        self, program: QuadraticProgram, name: str, is_sparse: bool, **options: float
    ) -> None:
        self._program, self._rows = program, OneSidedRows(program)
        self._name, self._is_sparse, self._options = name, is_sparse, options
        self.solution = np.zeros(program.size)
        self.solve_s = 0.0
        """of the last solve, the time in the solver itself"""
        self._P: Array | csc_matrix
        self._C: Array | csc_matrix
        self.update_matrices()

    def update_matrices(self) -> bool:
        self._rows.update_matrices()
        P, C = self._program.P, self._rows.C
        self._P, self._C = (csc_matrix(P), C) if self._is_sparse else (P, C.toarray())
        return True

    def solve(self) -> SolveStatus:
        import qpsolvers

        self._rows.update_vectors()
        problem = qpsolvers.Problem(self._P, self._program.q, self._C, self._rows.d)
        result = qpsolvers.solve_problem(problem, self._name, **self._options)
        self.solve_s = result.solve_time or 0.0
        if not result.found:
            return SolveStatus.NUMERICS
        self.solution[:] = result.x
        return SolveStatus.SOLVED


def open_clarabel(program: QuadraticProgram, tolerance: float) -> ColdSolver:
    """Clarabel, an interior-point method for conic programs: Goulart and Chen, 2024."""
    names = ("tol_gap_abs", "tol_gap_rel", "tol_feas")
    return ColdSolver(program, "clarabel", True, **dict.fromkeys(names, tolerance))


def open_quadprog(program: QuadraticProgram, _: float) -> ColdSolver:
    """The dual active-set method of Goldfarb and Idnani, 1983; it has no tolerance."""
    return ColdSolver(program, "quadprog", False)


TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
DEFAULT = "PIQP, warm"
COLD = "PIQP"
FAST = "DAQP"


class PeerSolver(Protocol):
    """The part of `Solver` that is compared."""

    solution: Array

    def update_matrices(self) -> bool: ...

    def solve(self) -> SolveStatus: ...


class SolverEntry(NamedTuple):
    """A solver that can be opened on a program."""

    name: str
    package: str
    """whose version is reported"""
    open: Callable[[QuadraticProgram, float], PeerSolver]
    """on a program, with a tolerance"""
    has_tolerance: bool = True
    """False: the tolerance is ignored"""

    @property
    def version(self) -> str:
        return metadata.version(self.package)


OWN = (
    SolverEntry(DEFAULT, "piqp", lambda program, _: open_solver(program), False),
    SolverEntry(COLD, "piqp", lambda program, _: open_solver(program, warm_start=False), False),
    SolverEntry(FAST, "daqp", lambda program, _: open_solver(program, "daqp"), False),
)
PEERS = (
    SolverEntry("OSQP", "osqp", warm_solvers.OsqpSolver),
    SolverEntry("ProxQP", "proxsuite", warm_solvers.ProxqpSolver),
    SolverEntry("QPALM", "qpalm", warm_solvers.QpalmSolver),
    SolverEntry("SCS", "scs", warm_solvers.ScsSolver),
    SolverEntry("QOCO", "qoco", warm_solvers.QocoSolver),
    SolverEntry("qpOASES (CasADi)", "casadi", warm_solvers.QpoasesSolver, False),
    SolverEntry("Clarabel", "clarabel", open_clarabel),
    SolverEntry("quadprog", "quadprog", open_quadprog, False),
)


def find_solvers(only: Sequence[str] = ()) -> tuple[list[SolverEntry], list[str]]:
    """The requested solvers that are installed, the controller's own first; names of the others."""
    requested = [entry for entry in PEERS if not only or entry.name in only]
    installed = [entry for entry in requested if find_spec(entry.package) is not None]
    missing = [entry.name for entry in requested if entry not in installed]
    return [*OWN, *installed], missing
