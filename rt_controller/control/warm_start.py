"""A solver behind a first try: the active set of the last solution."""

import numpy as np

from rt_controller.control.active_set import ActiveSetTry
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus

MOST_ROUNDS = 4
"""a round costs about a tenth of PIQP's solve; most solutions come in the first one"""


class WarmStarted:
    """Tries the last active set, and asks the solver behind it where that is not the answer.

    What the try finds is the exact solution: there is nothing to be said against it. What it costs
    where it fails is bounded by its rounds.
    """

    def __init__(
        self, program: QuadraticProgram, solver: PiqpSolver, most_rounds: int = MOST_ROUNDS
    ) -> None:
        self._solver = solver
        self._try = ActiveSetTry(program)
        self._most_rounds = most_rounds
        self._has_matrices = True
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def bound(self, budget_ns: int) -> None:
        """As `Solver.bound`: of the solver behind; the try is bounded by its rounds."""
        self._solver.bound(budget_ns)

    def renew(self) -> bool:
        """As `Solver.renew`."""
        # Both, always: a solver that is not told would go on with the matrices before.
        is_tried, is_solved = self._try.renew(), self._solver.renew()
        self._has_matrices = is_tried and is_solved
        return self._has_matrices

    def solve(self) -> SolveStatus:
        """As `Solver.solve`; `iterations` are those of the try and of the solver together."""
        self.iterations = 0
        if not self._has_matrices:
            return SolveStatus.NUMERICS
        found = self._try.attempt(self._most_rounds)
        self.iterations = self._try.rounds
        if found is not None:
            self.solution[:] = found
            return SolveStatus.SOLVED
        status = self._solver.solve()
        self.iterations += self._solver.iterations
        if status is SolveStatus.SOLVED:
            self.solution[:] = self._solver.solution
            self._try.adopt(*self._solver.active_bounds())
        return status
