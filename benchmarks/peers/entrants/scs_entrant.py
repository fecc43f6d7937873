"""SCS, a splitting conic solver: O'Donoghue, 2021."""

import numpy as np
import scs
from scipy.sparse import csc_matrix

from benchmarks.peers.entrants.one_sided import OneSided
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class ScsEntrant:
    """Warm from solve to solve; new matrices mean a new workspace."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program, self._rows = program, OneSided(program)
        self._tolerance = tolerance
        self._last: dict[str, np.ndarray] = {}
        self.renew()
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def renew(self) -> bool:
        self._rows.renew()
        data = {
            "P": csc_matrix(np.triu(self._program.P)),
            "A": self._rows.C,
            "b": self._rows.d,
            "c": self._program.q,
        }
        self._solver = scs.SCS(
            data,
            {"l": len(self._rows.d)},
            eps_abs=self._tolerance,
            eps_rel=0.0,
            verbose=False,
        )
        return True

    def solve(self) -> SolveStatus:
        self._rows.aim()
        self._solver.update(b=self._rows.d, c=self._program.q)
        result = self._solver.solve(warm_start=bool(self._last), **self._last)
        self._last = {name: result[name] for name in ("x", "y", "s")}
        self.iterations = result["info"]["iter"]
        if result["info"]["status_val"] != 1:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = result["x"]
        return SolveStatus.SOLVED
