"""All bounds of a program as rows of one sparse matrix, which most solvers want."""

import numpy as np
from scipy.sparse import csc_matrix

from rt_controller.contract.bundle import Array
from rt_controller.control.program import QuadraticProgram


class Stacked:
    """low <= A z <= high with A = [I; G] in compressed columns, without rows that bound nothing."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        n = program.size
        self.kept = np.flatnonzero(np.isfinite(program.bounds).any(axis=0))
        """(m,), rows that ever bound anything"""
        pattern = np.vstack([np.eye(n, dtype=bool), program.pattern])[self.kept]
        self._dense = np.vstack([np.eye(n), program.G])
        columns, rows = np.nonzero(pattern.T)
        self._places = self.kept[rows] * n + columns
        starts = np.searchsorted(columns, np.arange(n + 1))
        self.A = csc_matrix(
            (self._dense.reshape(-1)[self._places], rows, starts), shape=pattern.shape
        )
        self.bounds = program.bounds[:, self.kept]
        """(2, m), in memory that does not move"""

    @property
    def low(self) -> Array:
        """(m,), a view"""
        view: Array = self.bounds[0]
        return view

    @property
    def high(self) -> Array:
        """(m,), a view"""
        view: Array = self.bounds[1]
        return view

    def renew(self) -> None:
        """Take up the program's matrices."""
        self._dense[self._program.size :] = self._program.G
        np.take(self._dense.reshape(-1), self._places, out=self.A.data)

    def aim(self) -> None:
        """Take up its bounds."""
        np.take(self._program.bounds, self.kept, axis=1, out=self.bounds)


def every_entry(P: Array) -> csc_matrix:
    """The symmetric P with its zeros, in compressed columns: a later one may have others there."""
    n = len(P)
    rows, starts = np.tile(np.arange(n), n), np.arange(0, n * n + 1, n)
    return csc_matrix((P.reshape(-1).copy(), rows, starts), shape=P.shape)


def upper_triangle(P: Array) -> csc_matrix:
    """Every entry of the upper half of the symmetric P, zeros too, in compressed columns."""
    n = len(P)
    rows = np.concatenate([np.arange(column + 1) for column in range(n)])
    starts = np.cumsum([0, *range(1, n + 1)])
    return csc_matrix((P.T[np.tril_indices(n)], rows, starts), shape=P.shape)
