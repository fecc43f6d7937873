"""qpOASES, an online active-set strategy: Ferreau et al., 2014; as CasADi brings it."""

from typing import Any

import casadi
import numpy as np

from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus


class QpoasesEntrant:
    """Hot from solve to solve, through CasADi's buffers. `tolerance` is nothing to it."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program = program
        n, rows = program.size, len(program.G)
        pattern = program.pattern
        columns, places = np.nonzero(pattern.T)
        self._taken = places * n + columns
        shape: dict[str, Any] = {
            "h": casadi.Sparsity.dense(n, n),
            "a": casadi.Sparsity.triplet(rows, n, places.tolist(), columns.tolist()),
        }
        options: dict[str, Any] = {"printLevel": "none", "sparse": False, "error_on_fail": False}
        self._function = casadi.conic("peer", "qpoases", shape, options)
        buffer: Any
        buffer, self._run = self._function.buffer()
        self._buffer = buffer
        names = self._function.name_in()
        self._G = np.zeros(len(self._taken))
        self._vectors = np.zeros((4, max(n, rows)))
        lower, upper, row_lower, row_upper = (np.zeros(k) for k in (n, n, rows, rows))
        self._memory = (lower, upper, row_lower, row_upper)
        self.solution = np.zeros(n)
        self.iterations = 0
        given = {
            "h": program.P,
            "g": program.q,
            "a": self._G,
            "lbx": lower,
            "ubx": upper,
            "lba": row_lower,
            "uba": row_upper,
        }
        for name, memory in given.items():
            if memory.size:
                self._buffer.set_arg(names.index(name), memory.data)
        self._buffer.set_res(self._function.name_out().index("x"), self.solution.data)
        self.renew()

    def renew(self) -> bool:
        np.take(self._program.G.reshape(-1), self._taken, out=self._G)
        return True

    def solve(self) -> SolveStatus:
        program = self._program
        given = (program.lower, program.upper, program.row_lower, program.row_upper)
        for memory, vector in zip(self._memory, given, strict=True):
            memory[:] = vector
        self._run()
        return SolveStatus.SOLVED if self._buffer.ret() == 0 else SolveStatus.NUMERICS
