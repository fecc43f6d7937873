"""The active set of the last solution, tried on the next problem and believed only if it is right.

From one tick to the next mostly the same bounds are active. With them as equations the QP is a
system of linear equations; its solution is the QP's if it violates no bound and no multiplier has
the wrong sign. If not, exactly these say which bounds to try next: a primal-dual active set
iteration (Hintermüller, Ito and Kunisch, 2003), which need not converge and is given few rounds.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from rt_controller.contract.bundle import Array
from rt_controller.control.program import QuadraticProgram

MOST_ROUNDS = 6
VIOLATION = 1e-8
"""of a bound, in units of an input's range, that counts as none"""
WRONG_SIGN = 1e-9
"""of a multiplier that counts as zero"""
ACTIVE = 1e-5
"""from a bound, where another solver's solution counts as lying on it"""

DEPENDENT = 1e-10
"""of the largest pivot, below which one bound is implied by others"""

Places = NDArray[np.int64]


class ActiveSetTry:
    """Rounds of linear algebra on one program, and the active set they left."""

    def __init__(self, program: QuadraticProgram, most_rounds: int = MOST_ROUNDS) -> None:
        self._program = program
        self._most_rounds = most_rounds
        renews = program.renews_hessian or program.renews_rows
        self._system: _System = _RenewedSystem(program) if renews else _ConstantSystem(program)
        self._side = np.zeros(program.every_upper.size, dtype=np.int8)
        """(n + r,), +1 where the upper bound is active, -1 where the lower one is"""
        self._lower = np.zeros(program.every_lower.size)
        self._upper = np.zeros(program.every_upper.size)
        self.rounds = 0
        """of the last try"""

    def attempt(self) -> Array | None:
        """The solution (n,) of the program as it stands; None if it was not found."""
        program, side = self._program, self._side
        self.rounds = 0
        if not (program.is_finite and self._system.renew()):
            return None
        np.subtract(program.every_lower, VIOLATION, out=self._lower)
        np.add(program.every_upper, VIOLATION, out=self._upper)
        while self.rounds < self._most_rounds:
            self.rounds += 1
            active = np.flatnonzero(side)
            bounds = np.where(
                side[active] > 0, program.every_upper[active], program.every_lower[active]
            )
            point = self._system.solve(active, bounds)
            if point is None:
                return None
            if len(point.active) < len(active):  # the others follow from these
                side = _only(side, point.active)
            better = np.zeros_like(side)
            better[point.values > self._upper] = 1
            better[point.values < self._lower] = -1
            of_active = side[point.active]
            better[point.active] = np.where(
                point.multipliers * of_active > -WRONG_SIGN, of_active, 0
            )
            if np.array_equal(better, side):
                self._side = side
                return point.values[: program.size]
            side = better
        return None

    def adopt(self, solution: Array) -> None:
        """Start next time from what is active at this solution (n,), found elsewhere."""
        program = self._program
        values = np.concatenate([solution, program.G @ solution])
        self._side[:] = values > program.every_upper - ACTIVE
        self._side[values < program.every_lower + ACTIVE] = -1


class _Point(NamedTuple):
    """Where the objective is least with some bounds as equations."""

    values: Array
    """(n + r,), of the variables and of the rows"""
    active: Places
    """bounds taken as equations: those asked for, without what the others imply"""
    multipliers: Array
    """of each of these; positive where an upper bound holds the solution back"""


class _System(Protocol):
    def renew(self) -> bool:
        """Take up the program as it stands; False if it is not convex."""
        ...

    def solve(self, active: Places, bounds: Array) -> _Point | None:
        """The point at which `active` variables and rows equal `bounds`; None if they cannot."""
        ...


class _ConstantSystem:
    """Of constant matrices: all products of theirs are made once."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._q = program.q
        rows = np.vstack([np.eye(program.size), program.G])
        by_q = np.linalg.solve(program.P, rows.T)  # P^-1 [I, G']
        self._free = -np.ascontiguousarray(by_q.T)
        """(n + r, n), values without any bound, of q"""
        self._reach = rows @ by_q
        """(n + r, n + r), what a multiplier of each does to the value of each"""
        self._values = np.zeros(len(rows))

    def renew(self) -> bool:
        np.dot(self._free, self._q, out=self._values)
        return True

    def solve(self, active: Places, bounds: Array) -> _Point | None:
        reach = self._reach[active]
        found = _solve_positive(reach[:, active], self._values[active] - bounds)
        if found is None:
            return None
        multipliers, used = found
        if used is not None:
            active, reach = active[used], reach[used]
        return _Point(self._values - multipliers @ reach, active, multipliers)


class _RenewedSystem:
    """Of matrices that change from tick to tick: P is factorised at each."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        self._rows = np.vstack([np.eye(program.size), program.G])
        self._L = np.zeros_like(program.P)
        self._free = np.zeros(program.size)

    def renew(self) -> bool:
        program = self._program
        self._L, info = lapack.dpotrf(program.P.T, lower=1, clean=0)
        if info != 0:
            return False
        if program.renews_rows:
            self._rows[program.size :] = program.G
        self._free, _ = lapack.dtrtrs(self._L, -program.q, lower=1)
        return True

    def solve(self, active: Places, bounds: Array) -> _Point | None:
        reach, _ = lapack.dtrtrs(self._L, self._rows[active].T, lower=1)  # L^-1 of their rows
        found = _solve_positive(reach.T @ reach, self._free @ reach - bounds)
        if found is None:
            return None
        multipliers, used = found
        if used is not None:
            active, reach = active[used], reach[:, used]
        solution, _ = lapack.dtrtrs(self._L, self._free - reach @ multipliers, lower=1, trans=1)
        rows = self._rows[len(solution) :] @ solution
        return _Point(np.concatenate([solution, rows]), active, multipliers)


def _only(side: NDArray[np.int8], active: Places) -> NDArray[np.int8]:
    fewer = np.zeros_like(side)
    fewer[active] = side[active]
    return fewer


def _solve_positive(matrix: Array, right: Array) -> tuple[Array, Places | None] | None:
    """x of matrix x = right, the matrix being symmetric; None if it is indefinite.

    Where bounds depend on each other, as a ceiling that comes down at the slew rate depends on the
    slew row, the matrix is singular: then x is of the equations that imply the others, and which
    these are is said.
    """
    if right.size == 0:
        return right, None
    _, x, info = lapack.dposv(matrix, right, lower=1)
    if info == 0:
        return x, None
    _, pivots, rank, _ = lapack.dpstrf(matrix, lower=1, tol=DEPENDENT * matrix.diagonal().max())
    used = np.sort(pivots[:rank] - 1).astype(np.int64)
    _, x, info = lapack.dposv(matrix[np.ix_(used, used)], right[used], lower=1)
    return (x, used) if info == 0 else None
