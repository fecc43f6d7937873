"""The active set of the last solution, tried on the next problem and believed only if it is right.

From one tick to the next mostly the same bounds are active. With them as equations the QP is a
system of linear equations; its solution is the QP's if it violates no bound and no multiplier has
the wrong sign. If not, exactly these say which bounds to try next: a primal-dual active set
iteration (Hintermüller, Ito and Kunisch, 2003), which need not converge and is given few rounds.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from rt_controller.contract.bundle import Array
from rt_controller.control.program import QuadraticProgram

VIOLATION = 1e-8
"""of a bound, in units of an input's range, that counts as none"""
WRONG_SIGN = 1e-9
"""of a multiplier that counts as zero"""
DEPENDENT = 1e-10
"""of the largest pivot, below which one bound is implied by others"""

Places = NDArray[np.int64]


class ActiveSet(NamedTuple):
    """Bounds taken as equations."""

    places: Places
    """(k,), which of the variables and rows"""
    signs: Array
    """(k,), +1 where it is the upper bound, -1 where the lower one"""
    bounds: Places
    """(k,), where in all lower and then all upper bounds its value stands"""


class ActiveSetTry:
    """Rounds of linear algebra on one program, and the active set they left."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        self._equations = _Equations(program)
        self._of_bounds = program.bounds.reshape(-1)
        self._beyond = np.zeros(program.bounds.shape)
        nobody = np.zeros(program.bounds.shape[1], dtype=bool)
        self._set = _active_set(nobody, nobody)
        self.rounds = 0
        """of the last try"""

    def renew(self) -> bool:
        """Take up new matrices; False if P is not positive definite."""
        return self._equations.renew()

    def attempt(self, most_rounds: int) -> Array | None:
        """The solution (n,) of the program as it stands; None if it was not found."""
        program, active = self._program, self._set
        self.rounds = 0
        if not program.has_finite_vectors():
            return None
        self._equations.release(program.q)
        while self.rounds < most_rounds:
            self.rounds += 1
            point = self._equations.solve(active.places, self._of_bounds[active.bounds])
            if point is None:
                return None
            better = self._better(point, active)
            if better is None:
                self._set = active
                return point.values[: program.size]
            active = better
        return None

    def adopt(self, above: NDArray[np.bool_], below: NDArray[np.bool_]) -> None:
        """Start next time from these upper and lower bounds (n + r,), found elsewhere."""
        self._set = _active_set(above, below)

    def _better(self, point: "_Point", active: ActiveSet) -> ActiveSet | None:
        """What to try instead; None if nothing is better, which is to say optimal."""
        under, over = self._beyond
        np.subtract(point.values, self._program.every_upper, out=over)
        np.subtract(self._program.every_lower, point.values, out=under)
        pressure = point.multipliers * active.signs
        is_feasible = self._beyond.max() <= VIOLATION
        if is_feasible and (pressure.size == 0 or pressure.min() > -WRONG_SIGN):
            return None
        # Where both bounds are the same, either may hold.
        holding = (pressure > -WRONG_SIGN) | ((under + over)[active.places] >= 0.0)
        if is_feasible and holding.all():
            return None
        above, below = over > VIOLATION, under > VIOLATION
        above[active.places] = holding & (active.signs > 0.0)
        below[active.places] = holding & (active.signs < 0.0)
        return _active_set(above, below)


class _Point(NamedTuple):
    """Where the objective is least with some bounds as equations."""

    values: Array
    """(n + r,), of the variables and of the rows"""
    multipliers: Array
    """(k,), of each; positive where an upper bound holds the solution back, zero where others
    imply it"""


class _Equations:
    """The program with bounds as equations: what does not depend on vectors is made once."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        self._rows = np.vstack([np.eye(program.size), program.G])
        """(n + r, n)"""
        self._free = np.zeros(self._rows.shape)
        """(n + r, n), values without any bound, of q"""
        self._reach = np.zeros((len(self._rows), len(self._rows)))
        """(n + r, n + r), what a multiplier of each does to the value of each"""
        self._values = np.zeros(len(self._rows))
        self._factored: _Factored | None = None
        self.renew()

    def renew(self) -> bool:
        """Take up the matrices as they are; False if P is not positive definite."""
        program, self._factored = self._program, None
        if not program.has_finite_matrices():
            return False
        L, info = lapack.dpotrf(program.P.T, lower=1)
        if info != 0:
            return False
        inverse, _ = lapack.dpotri(L, lower=1, overwrite_c=1)
        inverse += np.tril(inverse, -1).T  # only the lower half is written
        if program.renews_rows:
            self._rows[program.size :] = program.G
        np.dot(self._rows, inverse, out=self._free)
        np.dot(self._free, self._rows.T, out=self._reach)
        np.negative(self._free, out=self._free)
        return True

    def release(self, q: Array) -> None:
        """Where everything would be without bounds."""
        np.dot(self._free, q, out=self._values)

    def solve(self, places: Places, bounds: Array) -> _Point | None:
        """The point at which these variables and rows equal `bounds`; None if they cannot."""
        if self._factored is None or self._factored.places is not places:
            self._factored = _factorise(self._reach, places)
        if self._factored is None:
            return None
        _, L, used, reach = self._factored
        free = self._values
        if len(places) == 0:
            return _Point(free, free[:0])
        short = free[places] - bounds
        if used is None:
            multipliers, _ = lapack.dpotrs(L, short, lower=1)
        else:
            multipliers = np.zeros(len(places))
            multipliers[used], _ = lapack.dpotrs(L, short[used], lower=1)
        return _Point(free - multipliers @ reach, multipliers)


class _Factored(NamedTuple):
    """What equations have in common whatever they equal."""

    places: Places
    L: Array
    """Cholesky factor of what their multipliers do to them"""
    used: Places | None
    """those of them that imply the others, if not all are needed"""
    reach: Array
    """(k, n + r), what their multipliers do to everything"""


def _factorise(reach: Array, places: Places) -> _Factored | None:
    """Their factor; None if there is none.

    Where bounds depend on each other, as a ceiling that comes down at the slew rate depends on the
    slew row, some imply the others and are enough.
    """
    of_places = reach[places]
    if len(places) == 0:
        return _Factored(places, np.zeros((0, 0)), None, of_places)
    among = of_places[:, places]
    L, info = lapack.dpotrf(among.T, lower=1, clean=0)
    least = DEPENDENT * among.diagonal().max()
    if info == 0 and L.diagonal().min() ** 2 > least:
        return _Factored(places, L, None, of_places)
    _, order, rank, _ = lapack.dpstrf(among, lower=1, tol=least)
    used = np.sort(order[:rank] - 1).astype(np.int64)
    L, info = lapack.dpotrf(among[np.ix_(used, used)].T, lower=1, clean=0)
    return _Factored(places, L, used, of_places) if info == 0 else None


def _active_set(above: NDArray[np.bool_], below: NDArray[np.bool_]) -> ActiveSet:
    places = np.flatnonzero(above | below)
    is_upper = above[places]
    signs = np.where(is_upper, 1.0, -1.0)
    return ActiveSet(places, signs, places + len(above) * is_upper)
