"""Quadratic programs of the controller, recorded in closed loop."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

from rt_controller.config import ControllerConfig, MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.control.eq14 import Corridor
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.warm_start import open_solver
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.node import plan_at_constant_speed
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep

Tier = Literal["slew", "corridor"]
TIERS: dict[Tier, Corridor | None] = {
    "slew": None,
    "corridor": Corridor(half_width_m=0.1, beyond_m=0.05),
}
"""60 bounded variables with 60 rows; with 100 rows and 40 more variables"""


class Matrices(NamedTuple):
    """New matrices, set before the period."""

    P: Array
    G: Array


class Vectors(NamedTuple):
    """One problem to solve."""

    q: Array
    bounds: Array
    is_warm_up: bool
    """solved between two periods, at the predicted state of the next one"""


@dataclass(frozen=True)
class Recording:
    """One drive: a program, and its changes in the order of time."""

    model: str
    scenario: str
    program: QuadraticProgram
    """as it was when recording began"""
    events: list[Matrices | Vectors] = field(default_factory=list)

    def replay(self, program: QuadraticProgram) -> Iterator[Matrices | Vectors]:
        """Write each event into `program`, a copy of this one's, then yield it."""
        for event in self.events:
            if isinstance(event, Matrices):
                program.P[:], program.G[:] = event
            else:
                program.q[:], program.bounds[:] = event.q, event.bounds
            yield event


def record(model: str, scenario: str, corridor: Corridor | None) -> Recording:
    """All problems of driving `scenario` in lockstep with a shipped model."""
    settings, bundle = MpcSettings(), load_bundle(shipped_model(model))
    solvers: list[_RecordingSolver] = []

    def open_recorder(program: QuadraticProgram) -> _RecordingSolver:
        solvers.append(_RecordingSolver(program))
        return solvers[0]

    horizon, cost, knots = settings.horizon, settings.cost(), settings.knots
    mpc = _MarkingMpc(bundle, horizon, cost, corridor, open_recorder, knots)
    mpc.recorder = recorder = solvers[0]
    recording = Recording(model, Path(scenario).stem, recorder.program.copy(), recorder.events)
    plan_at_constant_speed(mpc)
    drive_in_lockstep(ControllerConfig(), bundle, mpc, CarSettings(scenario=scenario))
    return recording


class _RecordingSolver:
    """The default solver, which stores every problem it is given."""

    def __init__(self, program: QuadraticProgram) -> None:
        self.program = program
        self.events: list[Matrices | Vectors] = []
        self.is_warm_up = False
        self._solver = open_solver(program)
        self.solution = self._solver.solution
        self.iterations = 0

    def limit_solve_time(self, budget_ns: int) -> int:
        return self._solver.limit_solve_time(budget_ns)

    def update_matrices(self) -> bool:
        self.events.append(Matrices(self.program.P.copy(), self.program.G.copy()))
        return self._solver.update_matrices()

    def solve(self) -> SolveStatus:
        program = self.program
        self.events.append(Vectors(program.q.copy(), program.bounds.copy(), self.is_warm_up))
        status = self._solver.solve()
        self.iterations = self._solver.iterations
        return status


class _MarkingMpc(Mpc):
    """Marks the problems that are solved in `warm_up`."""

    recorder: _RecordingSolver

    def warm_up(self) -> None:
        self.recorder.is_warm_up = True
        super().warm_up()
        self.recorder.is_warm_up = False
