"""Warm start of PIQP: the active set of the last solution is tried before it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from rt_controller.contract.arrays import Array
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram, SolveStatus

MAX_ROUNDS = 4
"""a round costs about a tenth of PIQP's solve; most solutions come in the first one"""
VIOLATION = 1e-8
"""of a bound, in units of an input's range, that counts as none"""
WRONG_SIGN = 1e-9
"""of a multiplier that counts as zero"""
DEPENDENT = 1e-10
"""of the largest pivot; below it a bound is implied by others"""

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class ActiveSet(NamedTuple):
    """k bounds taken as equations, each array (k,)."""

    indices: Indices
    """among the n variables and r rows"""
    signs: Array
    """+1 for an upper bound, -1 for a lower one"""
    bound_indices: Indices
    """of their values in `QuadraticProgram.bounds`, flat"""


class ActiveSetIteration:
    """Primal-dual active-set iteration, which keeps the active set of the last solution.

    Between two periods mostly the same bounds are active. With those as equations the QP is a
    linear system; its solution solves the QP if it violates no bound and no multiplier has the
    wrong sign. Otherwise the violated bounds and wrong signs give the next active set
    (Hintermüller, Ito and Kunisch, 2003). The iteration need not converge, so the number of rounds
    is limited.
    """

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        self._equality_qp = _EqualityQp(program)
        self._flat_bounds = program.bounds.reshape(-1)
        self._violation = np.zeros(program.bounds.shape)
        inactive = np.zeros(program.bounds.shape[1], dtype=bool)
        self._active = _active_set(inactive, inactive)
        self.rounds = 0
        """of the last `solve`"""

    def update_matrices(self) -> bool:
        """Read P and G again; False if P is not positive definite."""
        return self._equality_qp.update_matrices()

    def solve(self, max_rounds: int) -> Array | None:
        """Solution (n,) of the program with its present vectors; None if none was found."""
        program, active = self._program, self._active
        self.rounds = 0
        if not program.has_finite_vectors():
            return None
        self._equality_qp.update_q(program.q)
        while self.rounds < max_rounds:
            self.rounds += 1
            bounds = self._flat_bounds[active.bound_indices]
            solved = self._equality_qp.solve(active.indices, bounds)
            if solved is None:
                return None
            values, multipliers = solved
            following = self._next_active_set(values, multipliers * active.signs, active)
            if following is None:
                self._active = active
                return values[: program.size]
            active = following
        return None

    def start_from(self, upper_active: Flags, lower_active: Flags) -> None:
        """Begin the next solve with these upper and lower bounds (n + r,) active."""
        self._active = _active_set(upper_active, lower_active)

    def _next_active_set(
        self, values: Array, multipliers: Array, active: ActiveSet
    ) -> ActiveSet | None:
        """The active set of the next round; None if the values (n + r,) are optimal."""
        below, above = self._violation
        np.subtract(values, self._program.all_upper, out=above)
        np.subtract(self._program.all_lower, values, out=below)
        is_feasible = self._violation.max() <= VIOLATION
        if is_feasible and (multipliers.size == 0 or multipliers.min() > -WRONG_SIGN):
            return None
        # Where both bounds are equal, either may be active.
        remains = (multipliers > -WRONG_SIGN) | ((below + above)[active.indices] >= 0.0)
        if is_feasible and remains.all():
            return None
        upper_active, lower_active = above > VIOLATION, below > VIOLATION
        upper_active[active.indices] = remains & (active.signs > 0.0)
        lower_active[active.indices] = remains & (active.signs < 0.0)
        return _active_set(upper_active, lower_active)


class _EqualityQp:
    """The program with bounds as equations; everything independent of vectors is precomputed.

    With C = [I; G], all values are C z = -C P^-1 q - D' multipliers, where D are the rows of
    C P^-1 C' of the active bounds.
    """

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        self._C = np.vstack([np.eye(program.size), program.G])
        """(n + r, n)"""
        self._unconstrained_map = np.zeros(self._C.shape)
        """(n + r, n), -C P^-1"""
        self._dual_hessian = np.zeros((len(self._C), len(self._C)))
        """(n + r, n + r), C P^-1 C'"""
        self._unconstrained = np.zeros(len(self._C))
        """(n + r,), values without any bound"""
        self._factor: _Factor | None = None
        self.update_matrices()

    def update_matrices(self) -> bool:
        """Read P and G; False if P is not positive definite."""
        program, self._factor = self._program, None
        if not program.has_finite_matrices():
            return False
        L, info = lapack.dpotrf(program.P.T, lower=1)
        if info != 0:
            return False
        inverse, _ = lapack.dpotri(L, lower=1, overwrite_c=1)
        inverse += np.tril(inverse, -1).T  # LAPACK writes the lower half only
        if program.rows_vary:
            self._C[program.size :] = program.G
        np.dot(self._C, inverse, out=self._unconstrained_map)
        np.dot(self._unconstrained_map, self._C.T, out=self._dual_hessian)
        np.negative(self._unconstrained_map, out=self._unconstrained_map)
        return True

    def update_q(self, q: Array) -> None:
        np.dot(self._unconstrained_map, q, out=self._unconstrained)

    def solve(self, indices: Indices, bounds: Array) -> tuple[Array, Array] | None:
        """Values (n + r,) and multipliers (k,) where `indices` have the values `bounds`.

        A multiplier is positive where an upper bound is active, and zero where other equations
        imply its own. None if there is no such point.
        """
        if self._factor is None or self._factor.indices is not indices:
            self._factor = _factorise(self._dual_hessian, indices)
        if self._factor is None:
            return None
        _, L, independent, rows = self._factor
        values = self._unconstrained
        if len(indices) == 0:
            return values, values[:0]
        residual = values[indices] - bounds
        if independent is None:
            multipliers, _ = lapack.dpotrs(L, residual, lower=1)
        else:
            multipliers = np.zeros(len(indices))
            multipliers[independent], _ = lapack.dpotrs(L, residual[independent], lower=1)
        return values - multipliers @ rows, multipliers


class _Factor(NamedTuple):
    """Factorisation for one active set, whatever the values of its bounds."""

    indices: Indices
    L: Array
    """Cholesky factor of the dual Hessian of the independent equations"""
    independent: Indices | None
    """the equations that imply the others; None if all are independent"""
    rows: Array
    """(k, n + r), of the dual Hessian"""


def _factorise(dual_hessian: Array, indices: Indices) -> _Factor | None:
    """The factorisation; None if there is none.

    Equations may depend on each other: the upper bound of a pedal that falls at the slew rate, for
    example, depends on the slew row. Then an independent subset is used.
    """
    rows = dual_hessian[indices]
    if len(indices) == 0:
        return _Factor(indices, np.zeros((0, 0)), None, rows)
    block = rows[:, indices]
    L, info = lapack.dpotrf(block.T, lower=1, clean=0)
    smallest = DEPENDENT * block.diagonal().max()
    if info == 0 and L.diagonal().min() ** 2 > smallest:
        return _Factor(indices, L, None, rows)
    _, order, rank, _ = lapack.dpstrf(block, lower=1, tol=smallest)
    independent = np.sort(order[:rank] - 1).astype(np.int64)
    L, info = lapack.dpotrf(block[np.ix_(independent, independent)].T, lower=1, clean=0)
    return _Factor(indices, L, independent, rows) if info == 0 else None


def _active_set(upper_active: Flags, lower_active: Flags) -> ActiveSet:
    indices = np.flatnonzero(upper_active | lower_active)
    is_upper = upper_active[indices]
    signs = np.where(is_upper, 1.0, -1.0)
    return ActiveSet(indices, signs, indices + len(upper_active) * is_upper)


class WarmStartedSolver:
    """Active-set iteration from the last active set, and PIQP where that finds no solution.

    A solution of the iteration meets the optimality conditions of the QP. Its cost where it fails
    is limited by its rounds.
    """

    def __init__(self, program: QuadraticProgram, solver: PiqpSolver) -> None:
        self._solver = solver
        self._active_set = ActiveSetIteration(program)
        self._has_valid_matrices = self._is_read = True
        """`_is_read`: PIQP, which is rarely needed, has the present matrices"""
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def limit_solve_time(self, budget_ns: int) -> int:
        """Limit PIQP; the active-set iteration is limited by its rounds."""
        return self._solver.limit_solve_time(budget_ns)

    def update_matrices(self) -> bool:
        self._has_valid_matrices = self._active_set.update_matrices()
        self._is_read = False
        return self._has_valid_matrices

    def solve(self) -> SolveStatus:
        """As `Solver.solve`; `iterations` is the sum of rounds and iterations of PIQP."""
        self.iterations = 0
        if not self._has_valid_matrices:
            return SolveStatus.NUMERICS
        found = self._active_set.solve(MAX_ROUNDS)
        self.iterations = self._active_set.rounds
        if found is not None:
            self.solution[:] = found
            return SolveStatus.SOLVED
        if not self._is_read:
            self._is_read = self._solver.update_matrices()
        status = self._solver.solve()
        self.iterations += self._solver.iterations
        if status is SolveStatus.SOLVED:
            self.solution[:] = self._solver.solution
            self._active_set.start_from(*self._solver.active_bounds())
        return status
