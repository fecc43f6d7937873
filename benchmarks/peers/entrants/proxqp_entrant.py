"""ProxQP, a proximal augmented Lagrangian method: Bambade et al., 2022."""

import numpy as np
from proxsuite import proxqp

from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus

MOST_ROUNDS = 100
"""of its outer loop, of which it needs a dozen; on soft bounds near the limit of grip it may not
end by itself"""


class ProxqpEntrant:
    """Dense, warm from solve to solve."""

    def __init__(self, program: QuadraticProgram, tolerance: float) -> None:
        self._program = program
        rows = len(program.G)
        self._qp = proxqp.dense.QP(program.size, 0, rows, True)
        self._qp.settings.eps_abs = tolerance
        self._qp.settings.eps_rel = 0.0
        self._qp.settings.max_iter = MOST_ROUNDS
        self._qp.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._qp.init(
            program.P,
            program.q,
            None,
            None,
            program.G if rows else None,
            program.row_lower if rows else None,
            program.row_upper if rows else None,
            program.lower,
            program.upper,
        )
        self._qp.solve()  # an update before the first solve ends the process
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def renew(self) -> bool:
        program = self._program
        self._qp.update(
            H=program.P if program.renews_hessian else None,
            C=program.G if program.renews_rows else None,
        )
        return True

    def solve(self) -> SolveStatus:
        program = self._program
        bounds = {"l_box": program.lower, "u_box": program.upper}
        if len(program.G):
            bounds |= {"l": program.row_lower, "u": program.row_upper}
        self._qp.update(g=program.q, **bounds)
        self._qp.solve()
        self.iterations = self._qp.results.info.iter
        if self._qp.results.info.status != proxqp.PROXQP_SOLVED:
            return SolveStatus.ITERATION_LIMIT
        self.solution[:] = self._qp.results.x
        return SolveStatus.SOLVED
