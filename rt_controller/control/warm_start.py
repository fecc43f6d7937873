"""Warm start of PIQP: the active set of the last solution is tried before it."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from rt_controller.contract.arrays import Array
from rt_controller.control.piqp_solver import MAX_ITERATIONS, PiqpSolver
from rt_controller.control.program import QuadraticProgram, Solver, SolveStatus

MAX_ROUNDS = 4
"""a round costs about a tenth of PIQP's solve; most solutions come in the first one"""
VIOLATION = 1e-8
"""of a bound, in units of an input's range, that counts as none"""
WRONG_SIGN = 1e-9
"""of a multiplier that counts as zero"""
DEPENDENT = 1e-10
"""of the largest pivot; below it a bound is implied by others"""


class ActiveSetIteration:
    """Primal-dual active-set iteration, which keeps the active set of the last solution.

    Between two periods mostly the same bounds are active. With those as equations the QP is a
    linear system; its solution solves the QP if it violates no bound and no multiplier has the
    wrong sign. Otherwise the violated bounds and wrong signs give the next active set
    (Hintermüller, Ito and Kunisch, 2003). The iteration need not converge, so the number of rounds
    is limited.

    With C = [I; G], all values are C z = -C P^-1 q - D' multipliers, where D are the rows of
    C P^-1 C' of the active bounds. What does not depend on the vectors is computed beforehand.
    """

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        self._C = np.vstack([np.eye(program.size), program.G])
        """(n + r, n)"""
        rows = len(self._C)
        self._unconstrained_map = np.zeros(self._C.shape)
        """(n + r, n), -C P^-1"""
        self._dual_hessian = np.zeros((rows, rows))
        """(n + r, n + r), C P^-1 C'"""
        self._unconstrained = np.zeros(rows)
        """(n + r,), values without any bound"""
        self._violation = np.zeros(program.bounds.shape)
        self._independent: NDArray[np.int64] | None = None
        """active bounds that imply the others; None if all are independent"""
        inactive = np.zeros(rows, dtype=bool)
        self.start_from(inactive, inactive)
        self.rounds = 0
        """of the last `solve`"""
        self.update_matrices()

    def start_from(self, upper_active: NDArray[np.bool_], lower_active: NDArray[np.bool_]) -> None:
        """Begin the next solve with these upper and lower bounds (n + r,) active."""
        self._active = active = np.flatnonzero(upper_active | lower_active)
        """(k,) indices of the active bounds among variables and rows"""
        is_upper = upper_active[active]
        self._signs = np.where(is_upper, 1.0, -1.0)
        """(k,), +1 for an upper bound, -1 for a lower one"""
        self._bound_indices = active + len(upper_active) * is_upper
        """(k,) of their values in `QuadraticProgram.bounds`, flat"""
        self._is_factorised = False

    def update_matrices(self) -> bool:
        """Read P and G again; False if P is not positive definite."""
        program, self._is_factorised = self._program, False
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

    def solve(self, max_rounds: int) -> Array | None:
        """Solution (n,) of the program with its present vectors; None if none was found."""
        program, self.rounds = self._program, 0
        if not program.has_finite_vectors():
            return None
        np.dot(self._unconstrained_map, program.q, out=self._unconstrained)
        begun_from = self._active, self._signs, self._bound_indices
        while self.rounds < max_rounds:
            self.rounds += 1
            if not (self._is_factorised or self._factorise()):
                break
            values, multipliers = self._solve_equations()
            if self._is_optimal(values, multipliers * self._signs):
                return values[: program.size]
        self._active, self._signs, self._bound_indices = begun_from
        self._is_factorised = False
        return None

    def _factorise(self) -> bool:
        """Factorise the equations of the active set; False if there is no such point.

        Equations may depend on each other: the upper bound of a pedal that falls at the slew rate,
        for example, depends on the slew row. Then an independent subset is used.
        """
        self._rows = self._dual_hessian[self._active]
        self._independent = None
        self._is_factorised = True
        if len(self._active) == 0:
            return True
        block = self._rows[:, self._active]
        self._L, info = lapack.dpotrf(block.T, lower=1, clean=0)
        smallest = DEPENDENT * block.diagonal().max()
        if info == 0 and self._L.diagonal().min() ** 2 > smallest:
            return True
        _, order, rank, _ = lapack.dpstrf(block, lower=1, tol=smallest)
        self._independent = chosen = np.sort(order[:rank] - 1).astype(np.int64)
        self._L, info = lapack.dpotrf(block[np.ix_(chosen, chosen)].T, lower=1, clean=0)
        self._is_factorised = info == 0
        return self._is_factorised

    def _solve_equations(self) -> tuple[Array, Array]:
        """Values (n + r,) and multipliers (k,) where the active bounds hold with equality.

        A multiplier is positive where an upper bound is active, and zero where other equations
        imply its own.
        """
        values, active, chosen = self._unconstrained, self._active, self._independent
        if len(active) == 0:
            return values, values[:0]
        residual = values[active] - self._program.bounds.reshape(-1)[self._bound_indices]
        if chosen is None:
            multipliers, _ = lapack.dpotrs(self._L, residual, lower=1)
        else:
            multipliers = np.zeros(len(active))
            multipliers[chosen], _ = lapack.dpotrs(self._L, residual[chosen], lower=1)
        return values - multipliers @ self._rows, multipliers

    def _is_optimal(self, values: Array, multipliers: Array) -> bool:
        """True if the values (n + r,) are optimal; otherwise the next active set replaces this."""
        below, above = self._violation
        np.subtract(values, self._program.all_upper, out=above)
        np.subtract(self._program.all_lower, values, out=below)
        is_feasible = self._violation.max() <= VIOLATION
        if is_feasible and (multipliers.size == 0 or multipliers.min() > -WRONG_SIGN):
            return True
        # Where both bounds are equal, either may be active.
        active = self._active
        remains = (multipliers > -WRONG_SIGN) | ((below + above)[active] >= 0.0)
        if is_feasible and remains.all():
            return True
        upper_active, lower_active = above > VIOLATION, below > VIOLATION
        upper_active[active] = remains & (self._signs > 0.0)
        lower_active[active] = remains & (self._signs < 0.0)
        self.start_from(upper_active, lower_active)
        return False


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
        self.limit_solve_time = solver.limit_solve_time

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
            self._active_set.start_from(*self._solver.active_bounds())
            # PIQP ends within its tolerance; the active set that it found gives the exact solution.
            exact = self._active_set.solve(MAX_ROUNDS)
            self.solution[:] = self._solver.solution if exact is None else exact
            self.iterations += self._active_set.rounds
        return status


def open_solver(
    program: QuadraticProgram, warm_start: bool = True, max_iterations: int | None = None
) -> Solver:
    """Workspace of PIQP on this program; with `warm_start` the last active set is tried before.

    `max_iterations` of a solve of PIQP; None: those of its module.
    """
    solver = PiqpSolver(program, max_iterations or MAX_ITERATIONS)
    return WarmStartedSolver(program, solver) if warm_start else solver
