"""The quadratic program, preallocated, and what a solver of it has to do."""

from enum import Enum
from math import isfinite, isnan
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array


class QuadraticProgram:
    """minimise 1/2 z' P z + q' z subject to lower <= z <= upper, row_lower <= G z <= row_upper.

    P (n, n) is symmetric and positive definite, q (n,), G (r, n). Bounds may be infinite. Vectors
    change at every solve, P only where `hessian_varies`, and G only where `rows_vary` too; the
    solver is told by `Solver.update_matrices`.
    """

    def __init__(
        self,
        P: Array,
        q: Array,
        G: Array,
        pattern: NDArray[np.bool_],
        hessian_varies: bool = False,
        rows_vary: bool = False,
    ) -> None:
        """`pattern` (r, n) is True where an entry of G may be other than zero."""
        self.P, self.q, self.G, self.pattern = P, q, G, pattern
        self.hessian_varies, self.rows_vary = hessian_varies, rows_vary
        self.size = n = q.size
        self.bounds: Array = np.empty((2, n + len(G)))
        """(2, n + r), lower then upper bounds, of the variables and then of the rows"""
        self.bounds[0], self.bounds[1] = -np.inf, np.inf
        # Views of `bounds`:
        self.all_lower: Array
        self.all_upper: Array
        self.all_lower, self.all_upper = self.bounds
        self.lower, self.row_lower = self.all_lower[:n], self.all_lower[n:]
        self.upper, self.row_upper = self.all_upper[:n], self.all_upper[n:]

    def has_finite_vectors(self) -> bool:
        """True if q is finite and no bound is NaN."""
        # One sum and one minimum are cheaper than a test of every element.
        return isfinite(self.q.dot(self.q)) and not isnan(self.bounds.min())

    def has_finite_matrices(self) -> bool:
        """True if the matrices that may change are finite."""
        return isfinite(self.P.sum()) and (not self.rows_vary or isfinite(self.G.sum()))

    def copy(self) -> "QuadraticProgram":
        matrices = (self.P.copy(), self.q.copy(), self.G.copy(), self.pattern)
        program = QuadraticProgram(*matrices, self.hessian_varies, self.rows_vary)
        program.bounds[:] = self.bounds
        return program


class SolveStatus(Enum):
    """How a solve ended. Only a plan that is SOLVED is sent to the vehicle."""

    SOLVED = 0
    ITERATION_LIMIT = 1
    INFEASIBLE = 2
    NUMERICS = 3


class Solver(Protocol):
    """Workspace on one `QuadraticProgram`, whose vectors are read at every solve."""

    solution: Array
    """(n,), of the last solve that was SOLVED, the inputs first; overwritten by the next one"""
    iterations: int
    """of the last solve"""

    def limit_solve_time(self, budget_ns: int) -> int:
        """Limit the time of a solve; returns its most iterations on this machine from now on.

        Raises:
            ConfigError: a typical solve needs more time than that.
        """

    def update_matrices(self) -> bool:
        """Read the matrices again; False if they are not finite or not seen to be convex.

        After False every solve returns NUMERICS until valid matrices are read.
        """

    def solve(self) -> SolveStatus:
        """Status of solving the program with its present vectors."""
