"""Which solver, and what is tried before it."""

from enum import StrEnum

from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import Solver
from rt_controller.control.warm_start import WarmStarted


class SolverChoice(StrEnum):
    """By name, as on the command line."""

    PIQP = "piqp"
    """interior point"""
    DAQP = "daqp"
    """dual active set; needs the extra [daqp]"""


def open_solver(
    program: QuadraticProgram,
    choice: SolverChoice = SolverChoice.PIQP,
    warm_start: bool = True,
) -> Solver:
    """A workspace for this program.

    DAQP keeps its last active set by itself; for PIQP `warm_start` tries it before it.

    Raises:
        MissingExtraError: the solver is not installed.
        ConfigError: the solver refuses the program.
    """
    if choice is SolverChoice.DAQP:
        from rt_controller.control.daqp_solver import DaqpSolver

        return DaqpSolver(program)
    from rt_controller.control.piqp_solver import PiqpSolver

    solver = PiqpSolver(program)
    return WarmStarted(program, solver) if warm_start else solver
