"""QP solver as the controller uses it: set up once on a program, then vectors in, solution out."""

from enum import Enum
from typing import Protocol

from rt_controller.contract.arrays import Array
from rt_controller.control.program import QuadraticProgram


class SolveStatus(Enum):
    """How a solve ended. Only a plan that is SOLVED is sent to the vehicle."""

    SOLVED = 0
    ITERATION_LIMIT = 1
    INFEASIBLE = 2
    NUMERICS = 3


class Solver(Protocol):
    """Workspace on one `QuadraticProgram`, whose vectors are read at every solve."""

    solution: Array
    """(n,), of the last solve that was SOLVED, the inputs first; overwritten by the next one"""
    iterations: int
    """of the last solve"""

    def limit_solve_time(self, budget_ns: int) -> int:
        """Limit the time of a solve, from what an iteration takes on this machine.

        Returns the most iterations of a solve from now on.

        Raises:
            ConfigError: a typical solve needs more time than that.
        """

    def update_matrices(self) -> bool:
        """Read the matrices again; False if they are not finite or not seen to be convex.

        After False every solve returns NUMERICS until valid matrices are read.
        """

    def solve(self) -> SolveStatus:
        """Status of solving the program with its present vectors."""


def open_solver(
    program: QuadraticProgram, warm_start: bool = True, max_iterations: int | None = None
) -> Solver:
    """Workspace of PIQP on this program; with `warm_start` the last active set is tried before.

    `max_iterations` of a solve of PIQP; None: those of its module.

    Raises:
        ConfigError: PIQP refuses the program.
    """
    # Imported here: these modules import the types above.
    from rt_controller.control import piqp_solver
    from rt_controller.control.warm_start import WarmStartedSolver

    solver = piqp_solver.PiqpSolver(program, max_iterations or piqp_solver.MAX_ITERATIONS)
    return WarmStartedSolver(program, solver) if warm_start else solver
