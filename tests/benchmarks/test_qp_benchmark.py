"""The QPs of a recorded lane change, as they came, through the controller's own solvers."""

from functools import cache

import pytest

from benchmarks.peers.recording import Matrices, Recording, record
from benchmarks.peers.tiers import TIERS
from rt_controller.control.solver import SolveStatus
from rt_controller.control.solvers import SolverChoice, open_solver

SOLVERS = {
    "piqp-cold": {"warm_start": False},
    "piqp-warm": {},
    "daqp": {"choice": SolverChoice.DAQP},
}


@cache
def recorded(tier: str) -> Recording:
    return record("mdk-net-paper", "double_lane_change", TIERS[tier])


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tier", TIERS)
def test_solve(benchmark, tier: str, solver: str) -> None:
    recording = recorded(tier)
    program = recording.copy()
    workspace = open_solver(program, **SOLVERS[solver])
    events = recording.replay(program)

    def until_the_next_tick() -> None:
        nonlocal events
        while True:
            event = next(events, None)
            if event is None:
                events = recording.replay(program)
            elif isinstance(event, Matrices):
                workspace.renew()
            elif event.is_rehearsal:
                workspace.solve()
            else:
                return

    status = benchmark.pedantic(workspace.solve, setup=until_the_next_tick, rounds=400)
    assert status is SolveStatus.SOLVED
