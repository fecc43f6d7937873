"""PIQP on a condensed program: its time depends on the number of iterations and little else."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from rt_controller.contract.bundle import Array
from rt_controller.control.piqp_workspace import PiqpWorkspace
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus

MAX_ITERATIONS = 16
"""enough for every problem that a drive has brought so far"""
LEAST_ITERATIONS = 12
"""cut shorter than this, the first input may be wrong by more than 1e-4 of its range"""


class PiqpSolver:
    """With a constant P and with a new one every tick.

    Raises:
        ConfigError: the program is not a convex QP.
    """

    def __init__(self, program: QuadraticProgram, max_iterations: int = MAX_ITERATIONS) -> None:
        self._program = program
        self._P = _columns_of_symmetric(program.P)
        self._G = _Columns(program.G, program.pattern)
        self._has_rows = len(program.G) > 0
        self._workspace = PiqpWorkspace(max_iterations, LEAST_ITERATIONS)
        self._solver = self._workspace.solver
        self._has_matrices = True
        self.solution = np.zeros(program.size)
        self.iterations = 0
        rows = (self._G.matrix, program.row_lower, program.row_upper)
        self._solver.setup(
            self._P,
            program.q,
            None,
            None,
            *(rows if self._has_rows else (None, None, None)),
            program.lower,
            program.upper,
        )
        self._workspace.try_once()

    def bound(self, budget_ns: int) -> None:
        """As `Solver.bound`."""
        self._workspace.bound(budget_ns)

    def renew(self) -> bool:
        """As `Solver.renew`."""
        program = self._program
        # PIQP would keep what is not a number, and fail on every later problem too.
        self._has_matrices = program.has_finite_matrices()
        if self._has_matrices and program.renews:
            self._solver.update(
                P=self._P if program.renews_hessian else None,
                G=self._G.renew() if program.renews_rows else None,
            )
        return self._has_matrices

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        program = self._program
        self.iterations = 0
        if not (self._has_matrices and program.has_finite_vectors()):
            return SolveStatus.NUMERICS
        self._solver.update(
            c=program.q,
            h_l=program.row_lower if self._has_rows else None,
            h_u=program.row_upper if self._has_rows else None,
            x_u=program.upper,
        )
        status = self._workspace.run()
        self.iterations = self._workspace.iterations
        if status is SolveStatus.SOLVED:
            if not np.isfinite(self._workspace.x).all():
                return SolveStatus.NUMERICS
            self.solution[:] = self._workspace.x
        return status

    def active_bounds(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which upper and lower bounds (n + r,) hold the last solution back.

        Those whose multiplier is larger than their slack: on the way to the optimum the product of
        the two is the same for all, and one of them goes to zero.
        """
        r = self._solver.result
        above = np.concatenate([r.z_bu > r.s_bu, r.z_u > r.s_u])
        return above, np.concatenate([r.z_bl > r.s_bl, r.z_l > r.s_l])


class _Columns:
    """G as PIQP takes it: column by column, without what is always zero."""

    def __init__(self, G: Array, pattern: NDArray[np.bool_]) -> None:
        columns, rows = np.nonzero(pattern.T)
        self._entries = G.reshape(-1)
        self._places = rows * G.shape[1] + columns
        starts = np.searchsorted(columns, np.arange(G.shape[1] + 1)).astype(np.int32)
        values = self._entries[self._places]
        self.matrix = csc_matrix((values, rows.astype(np.int32), starts), shape=G.shape)

    def renew(self) -> csc_matrix:
        """The matrix as G is now."""
        np.take(self._entries, self._places, out=self.matrix.data)
        return self.matrix


def _columns_of_symmetric(P: Array) -> csc_matrix:
    """The symmetric P as PIQP takes it, in the same memory: its rows are its columns.

    Zeros are entries like any others: a later P may have something there.
    """
    size = P.shape[0]
    rows = np.tile(np.arange(size, dtype=np.int32), size)
    starts = np.arange(0, size * size + 1, size, dtype=np.int32)
    return csc_matrix((P.reshape(-1), rows, starts), shape=P.shape)
