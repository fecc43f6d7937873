"""DAQP, a dual active-set method, which starts from the last active set.

Arnström, Bemporad and Axehill, *A Dual Active-Set Solver for Embedded Quadratic Programming Using
Recursive LDL' Updates*, 2022.
"""

from math import isfinite

import numpy as np

from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus

MAX_ITERATIONS = 200
"""each adds or drops one constraint; only the last iterate is feasible"""

_STATUS = {1: SolveStatus.SOLVED, -1: SolveStatus.INFEASIBLE, -4: SolveStatus.ITERATION_LIMIT}


class DaqpSolver:
    """`Solver` by DAQP, warm-started from solve to solve.

    Raises:
        MissingExtraError: DAQP is not installed.
        ConfigError: the program is not a convex QP.
    """

    def __init__(self, program: QuadraticProgram, max_iterations: int = MAX_ITERATIONS) -> None:
        with needs_extra("daqp", "`mpc.solver` daqp"):
            import daqp
        self._program = program
        self._has_valid_matrices = True
        self._model = daqp.Model()
        self.solution = np.zeros(program.size)
        self.iterations = 0
        sense = np.zeros(program.all_upper.size, dtype=np.intc)
        flag, _ = self._model.setup(
            program.P, program.q, program.G, program.all_upper, program.all_lower, sense
        )
        if flag < 0:
            raise ConfigError(
                "DAQP refuses the assembled problem: expected a convex QP, found exit flag "
                f"{flag} at start. Check `mpc.tolerance` and the other weights."
            )
        self._model.settings = {**self._model.settings, "iter_limit": max_iterations}

    def limit_solve_time(self, budget_ns: int) -> int:
        """As `Solver.limit_solve_time`; DAQP measures its time itself."""
        self._model.settings = {**self._model.settings, "time_limit": budget_ns / 1e9}
        return int(self._model.settings["iter_limit"])

    def update_matrices(self) -> bool:
        program = self._program
        self._has_valid_matrices = program.has_finite_matrices()
        if self._has_valid_matrices and program.hessian_varies:
            # DAQP factorises P here; the flag is negative if P is not positive definite.
            flag = self._model.update(
                H=program.P,
                A=program.G if program.rows_vary else None,
            )
            self._has_valid_matrices = flag >= 0
        return self._has_valid_matrices

    def solve(self) -> SolveStatus:
        program = self._program
        self.iterations = 0
        if not (self._has_valid_matrices and program.has_finite_vectors()):
            return SolveStatus.NUMERICS
        flag = self._model.update(f=program.q, bupper=program.all_upper, blower=program.all_lower)
        if flag < 0:
            # The workspace still holds the last problem, and would return its solution.
            return _STATUS.get(flag, SolveStatus.NUMERICS)
        solution, _, flag, info = self._model.solve()
        self.iterations = info["iterations"]
        status = _STATUS.get(flag, SolveStatus.NUMERICS)
        if status is SolveStatus.SOLVED:
            self.solution[:] = solution
            if not isfinite(self.solution.dot(self.solution)):
                return SolveStatus.NUMERICS
        return status
