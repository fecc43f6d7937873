"""Registry of the compared solvers: name, package and wrapper."""

from collections.abc import Callable, Sequence
from importlib import metadata
from importlib.util import find_spec
from typing import NamedTuple, Protocol

from benchmarks.peers.solvers import cold_solvers, warm_solvers
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import hint
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.warm_start import open_solver

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
DEFAULT = "PIQP, warm"
COLD = "PIQP"


class PeerSolver(Protocol):
    """The part of `Solver` that is compared."""

    solution: Array

    def update_matrices(self) -> bool: ...

    def solve(self) -> SolveStatus: ...


class SolverEntry(NamedTuple):
    """A solver that can be opened on a program."""

    name: str
    package: str
    """whose version is reported"""
    open: Callable[[QuadraticProgram, float], PeerSolver]
    """on a program, with a tolerance"""
    has_tolerance: bool = True
    """False: the tolerance is ignored"""

    @property
    def version(self) -> str:
        return metadata.version(self.package)


OWN = (
    SolverEntry(DEFAULT, "piqp", lambda program, _: open_solver(program), False),
    SolverEntry(COLD, "piqp", lambda program, _: open_solver(program, warm_start=False), False),
)
PEERS = (
    SolverEntry("OSQP", "osqp", warm_solvers.OsqpSolver),
    SolverEntry("ProxQP", "proxsuite", warm_solvers.ProxqpSolver),
    SolverEntry("QPALM", "qpalm", warm_solvers.QpalmSolver),
    SolverEntry("SCS", "scs", warm_solvers.ScsSolver),
    SolverEntry("QOCO", "qoco", cold_solvers.QocoSolver),
    SolverEntry("qpOASES (CasADi)", "casadi", warm_solvers.QpoasesSolver, False),
    SolverEntry("Clarabel", "clarabel", cold_solvers.open_clarabel),
    SolverEntry("quadprog", "quadprog", cold_solvers.open_quadprog, False),
)


def require_names(only: Sequence[str]) -> None:
    """Return if each name is one of a solver.

    Raises:
        ConfigError: one is not.
    """
    names = [entry.name for entry in (*OWN, *PEERS)]
    for found in only:
        if found not in names:
            raise ConfigError(
                f"--only {found!r}: expected one of {'; '.join(names)}{hint(found, names)}."
            )


def find_solvers(only: Sequence[str] = ()) -> tuple[list[SolverEntry], list[str]]:
    """The requested solvers that are installed, the controller's own first; names of the others."""
    requested = [entry for entry in PEERS if not only or entry.name in only]
    installed = [entry for entry in requested if find_spec(entry.package) is not None]
    missing = [entry.name for entry in requested if entry not in installed]
    return [*OWN, *installed], missing
