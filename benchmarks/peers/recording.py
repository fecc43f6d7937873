"""Quadratic programs as the controller meets them, recorded in closed loop."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from benchmarks.peers.lockstep import drive, plain_config
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.formulation import Formulation, Solving
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.qp import Features
from rt_controller.control.solver import Solver, SolveStatus
from rt_controller.control.solvers import open_solver
from rt_controller.session import shipped_model


class Matrices(NamedTuple):
    """New ones, known before the tick."""

    P: Array
    G: Array


class Vectors(NamedTuple):
    """One problem to solve."""

    q: Array
    bounds: Array
    is_rehearsal: bool
    """solved between the ticks, as what the next one is expected to be"""


@dataclass(frozen=True)
class Recording:
    """One drive: a program, and what became of it in the order of time."""

    model: str
    scenario: str
    program: QuadraticProgram
    events: list[Matrices | Vectors] = field(default_factory=list)

    def replay(self, program: QuadraticProgram) -> Iterator[Matrices | Vectors]:
        """Write each event into `program`, a `copy` of this one's, then tell which it was."""
        for event in self.events:
            if isinstance(event, Matrices):
                program.P[:], program.G[:] = event
            else:
                program.q[:], program.bounds[:] = event.q, event.bounds
            yield event

    def copy(self) -> QuadraticProgram:
        """The program as it was when recording began, in memory of its own."""
        return copied(self.program)


def copied(program: QuadraticProgram) -> QuadraticProgram:
    """The same program in memory of its own."""
    copy = QuadraticProgram(
        program.P.copy(),
        program.q.copy(),
        program.G.copy(),
        program.pattern.copy(),
        program.renews_hessian,
        program.renews_rows,
    )
    copy.bounds[:] = program.bounds
    return copy


def record(model: str, scenario: str, features: Features) -> Recording:
    """Drive `scenario` in lockstep with a shipped model; every problem on the way."""
    config, bundle = plain_config(), load_bundle(shipped_model(model))
    settings = config.mpc
    solvers: list[_Recorder] = []

    def recorder(program: QuadraticProgram) -> "_Recorder":
        solvers.append(_Recorder(program))
        return solvers[0]

    solving = Solving(Formulation.CONDENSED, recorder)
    mpc = _Rehearsing(bundle, settings.horizon, settings.cost(), INPUT_LIMITS, features, solving)
    (solver,) = solvers
    mpc.recorder = solver
    found = Recording(model, Path(scenario).stem, copied(solver.program))
    solver.events = found.events
    drive(config, bundle, mpc, scenario)
    return found


class _Rehearsing(Mpc):
    """Says which solves are rehearsals."""

    recorder: "_Recorder"

    def rehearse(self) -> None:
        self.recorder.is_rehearsing = True
        super().rehearse()
        self.recorder.is_rehearsing = False


class _Recorder:
    """Solves as the default does, and writes down what it was asked."""

    def __init__(self, program: QuadraticProgram) -> None:
        self.program = program
        self.events: list[Matrices | Vectors] = []
        self.is_rehearsing = False
        self._solver: Solver = open_solver(program)
        self.solution = self._solver.solution
        self.iterations = 0

    def bound(self, budget_ns: int) -> None:
        self._solver.bound(budget_ns)

    def renew(self) -> bool:
        self.events.append(Matrices(self.program.P.copy(), self.program.G.copy()))
        return self._solver.renew()

    def solve(self) -> SolveStatus:
        program = self.program
        self.events.append(Vectors(program.q.copy(), program.bounds.copy(), self.is_rehearsing))
        status = self._solver.solve()
        self.iterations = self._solver.iterations
        return status
