"""All bounds of a program as rows C z <= d, for solvers that know no two-sided rows."""

import numpy as np
from scipy.sparse import csc_matrix, vstack

from benchmarks.peers.entrants.stacked import Stacked
from rt_controller.control.program import QuadraticProgram


class OneSided:
    """C = [A; -A], d = [high; -low], without rows that bound nothing."""

    def __init__(self, program: QuadraticProgram) -> None:
        self._stacked = Stacked(program)
        self._stacked.aim()
        self._uppers = np.flatnonzero(np.isfinite(self._stacked.high))
        self._lowers = np.flatnonzero(np.isfinite(self._stacked.low))
        self.C = self._rows()
        self.d = np.zeros(self.C.shape[0])
        self.aim()

    def renew(self) -> None:
        """Take up the program's matrices."""
        self._stacked.renew()
        self.C = self._rows()

    def aim(self) -> None:
        """Take up its bounds."""
        self._stacked.aim()
        self.d[: len(self._uppers)] = self._stacked.high[self._uppers]
        np.negative(self._stacked.low[self._lowers], out=self.d[len(self._uppers) :])

    def _rows(self) -> csc_matrix:
        A = self._stacked.A.tocsr()
        return vstack([A[self._uppers], -A[self._lowers]]).tocsc()
