"""What a QP solver is to the controller: set up once, then vectors in and a solution out."""

from enum import Enum
from typing import Protocol

from rt_controller.contract.bundle import Array


class SolveStatus(Enum):
    """How a solve ended; only SOLVED may be driven."""

    SOLVED = 0
    ITERATION_LIMIT = 1
    INFEASIBLE = 2
    NUMERICS = 3


class Solver(Protocol):
    """A workspace around one program, whose vectors it reads at every solve."""

    solution: Array
    """Of the last solve that was SOLVED, the inputs first; overwritten by the next."""
    iterations: int
    """of the last solve"""

    def bound(self, budget_ns: int) -> None:
        """Never take much longer than this for a solve; on this machine, so not repeatable.

        Raises:
            ConfigError: a usual solve would not be done by then.
        """
        ...

    def renew(self) -> bool:
        """Read the matrices again; False if they are seen to make no convex QP.

        Then every solve is NUMERICS, until matrices come that do.
        """
        ...

    def solve(self) -> SolveStatus:
        """How solving the program as it stands ended."""
        ...
