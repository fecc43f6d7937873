"""All bounds of a program as the rows of one sparse matrix."""

import numpy as np
from scipy.sparse import csc_matrix, vstack

from rt_controller.contract.arrays import Array
from rt_controller.control.program import QuadraticProgram


class TwoSidedRows:
    """low <= A z <= high with A = [I; G] in compressed columns, without rows of infinite bounds."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._program = program
        n = program.size
        self._kept = np.flatnonzero(np.isfinite(program.bounds).any(axis=0))
        self._pattern = np.vstack([np.eye(n, dtype=bool), program.pattern])[self._kept]
        self.A = csc_matrix(self._pattern, dtype=float)
        self.update_matrices()
        self._bounds = program.bounds[:, self._kept]
        self.low: Array = self._bounds[0]
        self.high: Array = self._bounds[1]

    def update_matrices(self) -> None:
        A = np.vstack([np.eye(self._program.size), self._program.G])[self._kept]
        self.A.data[:] = A.T[self._pattern.T]

    def update_vectors(self) -> None:
        np.take(self._program.bounds, self._kept, axis=1, out=self._bounds)


class OneSidedRows:
    """C z <= d with C = [A; -A] and d = [high; -low], without rows of infinite bounds."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._rows = TwoSidedRows(program)
        self._upper = np.flatnonzero(np.isfinite(self._rows.high))
        self._lower = np.flatnonzero(np.isfinite(self._rows.low))
        self.update_matrices()
        self.update_vectors()

    def update_matrices(self) -> None:
        self._rows.update_matrices()
        A = self._rows.A.tocsr()
        self.C = csc_matrix(vstack([A[self._upper], -A[self._lower]]))

    def update_vectors(self) -> None:
        self._rows.update_vectors()
        self.d = np.concatenate([self._rows.high[self._upper], -self._rows.low[self._lower]])


def upper_triangle(P: Array) -> csc_matrix:
    """The upper half of the symmetric P with its zeros, in compressed columns."""
    n = len(P)
    rows = np.concatenate([np.arange(column + 1) for column in range(n)])
    starts = np.cumsum([0, *range(1, n + 1)])
    return csc_matrix((P.T[np.tril_indices(n)], rows, starts), shape=P.shape)
