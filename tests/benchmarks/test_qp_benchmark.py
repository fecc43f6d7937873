"""Time of the controller's solvers on the QPs of a recorded lane change."""

from functools import cache

import pytest
from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.peers.recording import TIERS, Matrices, Recording, record
from rt_controller.control.program import SolveStatus
from rt_controller.control.warm_start import open_solver

SOLVERS = {
    "piqp-cold": {"warm_start": False},
    "piqp-warm": {},
}


@cache
def recorded(tier: str) -> Recording:
    return record("mdk-net-paper", SHORT_LANE_CHANGE, TIERS[tier])


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tier", TIERS)
def test_solve(benchmark, tier: str, solver: str) -> None:
    recording = recorded(tier)
    program = recording.program.copy()
    workspace = open_solver(program, **SOLVERS[solver])
    events = recording.replay(program)

    def go_to_next_tick() -> None:
        nonlocal events
        while True:
            event = next(events, None)
            if event is None:
                events = recording.replay(program)
            elif isinstance(event, Matrices):
                workspace.update_matrices()
            elif event.is_warm_up:
                workspace.solve()
            else:
                return

    status = benchmark.pedantic(workspace.solve, setup=go_to_next_tick, rounds=400)
    assert status is SolveStatus.SOLVED
