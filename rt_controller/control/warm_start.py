"""A solver behind a first try: the active set of the last solution."""

import numpy as np

from rt_controller.control.active_set import ActiveSetTry
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import Solver, SolveStatus


class WarmStarted:
    """Tries the last active set, and asks the solver behind it where that is not the answer.

    What the try finds is the exact solution: there is nothing to be said against it. What it costs
    where it fails is bounded by its rounds.
    """

    def __init__(self, program: QuadraticProgram, solver: Solver) -> None:
        self._solver = solver
        self._try = ActiveSetTry(program)
        self.solution = np.zeros(program.size)
        self.iterations = 0

    def solve(self) -> SolveStatus:
        """As `Solver.solve`; `iterations` are those of the try and of the solver together."""
        found = self._try.attempt()
        self.iterations = self._try.rounds
        if found is not None:
            self.solution[:] = found
            return SolveStatus.SOLVED
        status = self._solver.solve()
        self.iterations += self._solver.iterations
        if status is SolveStatus.SOLVED:
            self.solution[:] = self._solver.solution
            self._try.adopt(self.solution)
        return status
