"""Who takes part, under which name, and what has to be installed for it."""

from collections.abc import Callable, Sequence
from importlib import import_module, metadata
from typing import NamedTuple, Protocol

from rt_controller.contract.bundle import Array
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.solver import SolveStatus
from rt_controller.control.solvers import SolverChoice, open_solver

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


class Racer(Protocol):
    """What is asked of a solver here: the controller's protocol without its bound in time."""

    solution: Array

    def renew(self) -> bool:
        """As `Solver.renew`."""
        ...

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        ...


class Entrant(NamedTuple):
    """A solver that can be opened on a program."""

    name: str
    package: str
    """whose version is printed"""
    open: Callable[[QuadraticProgram, float], Racer]
    """on a program, to a tolerance"""
    has_tolerance: bool
    """whether that changes anything"""

    @property
    def version(self) -> str:
        return metadata.version(self.package)


DEFAULT = "PIQP, warm"
COLD = "PIQP"
FAST = "DAQP"

OWN = (
    Entrant(DEFAULT, "piqp", lambda program, _: open_solver(program), False),
    Entrant(COLD, "piqp", lambda program, _: open_solver(program, warm_start=False), False),
    Entrant(FAST, "daqp", lambda program, _: open_solver(program, SolverChoice.DAQP), False),
)
_OTHERS = (
    ("OSQP", "osqp", "osqp_entrant", "OsqpEntrant", True),
    ("ProxQP", "proxsuite", "proxqp_entrant", "ProxqpEntrant", True),
    ("Clarabel", "clarabel", "clarabel_entrant", "ClarabelEntrant", True),
    ("QPALM", "qpalm", "qpalm_entrant", "QpalmEntrant", True),
    ("SCS", "scs", "scs_entrant", "ScsEntrant", True),
    ("quadprog", "quadprog", "quadprog_entrant", "QuadprogEntrant", False),
    ("QOCO", "qoco", "qoco_entrant", "QocoEntrant", True),
    ("qpOASES (CasADi)", "casadi", "qpoases_entrant", "QpoasesEntrant", False),
)


def entrants(only: Sequence[str] = ()) -> tuple[list[Entrant], list[str]]:
    """Those wanted that are installed, and the names of those that are not."""
    found, missing = list(OWN), []
    for name, package, module, factory, has_tolerance in _OTHERS:
        if only and name not in only:
            continue
        try:
            opener = getattr(import_module(f"benchmarks.peers.entrants.{module}"), factory)
        except ModuleNotFoundError:
            missing.append(name)
        else:
            found.append(Entrant(name, package, opener, has_tolerance))
    return found, missing
