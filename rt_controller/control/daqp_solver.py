"""DAQP, a dual active-set method: starts from the last active set and mostly finds it right.

Arnström, Bemporad and Axehill, *A Dual Active-Set Solver for Embedded Quadratic Programming Using
Recursive LDL' Updates*, 2022.
"""

from math import isfinite

import numpy as np

from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus

MAX_ITERATIONS = 200
"""each adds or drops one constraint; an iterate before the last is not feasible"""

_STATUS = {
    1: SolveStatus.SOLVED,
    -1: SolveStatus.INFEASIBLE,
    -4: SolveStatus.ITERATION_LIMIT,
}


class DaqpSolver:
    """One DAQP workspace, warm from solve to solve.

    Raises:
        MissingExtraError: DAQP is not installed.
        ConfigError: the program is not a convex QP.
    """

    def __init__(self, program: QuadraticProgram, max_iterations: int = MAX_ITERATIONS) -> None:
        try:
            import daqp
        except ModuleNotFoundError as error:
            raise MissingExtraError(
                "--mpc.solver daqp: expected the extra [daqp], found it missing. Install it "
                'with: pip install -e ".[daqp]"'
            ) from error
        self._program = program
        self._has_matrices = True
        self._model = daqp.Model()
        self.solution = np.zeros(program.size)
        self.iterations = 0
        sense = np.zeros(program.every_upper.size, dtype=np.intc)
        flag, _ = self._model.setup(
            program.P, program.q, program.G, program.every_upper, program.every_lower, sense
        )
        if flag < 0:
            raise ConfigError(
                "DAQP refuses the assembled problem: expected a convex QP, found exit flag "
                f"{flag} at start. Check the --mpc weights and limits."
            )
        self._model.settings = {**self._model.settings, "iter_limit": max_iterations}

    def bound(self, budget_ns: int) -> None:
        """As `Solver.bound`; DAQP looks at the clock itself."""
        self._model.settings = {**self._model.settings, "time_limit": budget_ns / 1e9}

    def renew(self) -> bool:
        """As `Solver.renew`."""
        program = self._program
        self._has_matrices = program.has_finite_matrices()
        if self._has_matrices and program.renews:
            # The workspace factorises P here; it says so if that cannot be done.
            flag = self._model.update(
                H=program.P if program.renews_hessian else None,
                A=program.G if program.renews_rows else None,
            )
            self._has_matrices = flag >= 0
        return self._has_matrices

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        program = self._program
        self.iterations = 0
        if not (self._has_matrices and program.has_finite_vectors()):
            return SolveStatus.NUMERICS
        flag = self._model.update(
            f=program.q, bupper=program.every_upper, blower=program.every_lower
        )
        if flag < 0:
            # The workspace still holds the problem before: its solution would look like one.
            return _STATUS.get(flag, SolveStatus.NUMERICS)
        solution, _, flag, info = self._model.solve()
        self.iterations = info["iterations"]
        status = _STATUS.get(flag, SolveStatus.NUMERICS)
        if status is SolveStatus.SOLVED:
            self.solution[:] = solution
            if not isfinite(self.solution.dot(self.solution)):
                return SolveStatus.NUMERICS
        return status
