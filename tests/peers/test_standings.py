"""The race is fair: right answers are certified, wrong ones are seen, only the tick is timed."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("daqp", reason="the extra [daqp] is not installed")

from benchmarks.peers.entrants.roster import OWN, Entrant
from benchmarks.peers.exact import CERTAIN, exact_first_inputs, optimality_error
from benchmarks.peers.race import EXACT_ENOUGH, Mode, drive_lap, find_tolerance, first_input_error
from benchmarks.peers.ratio import p50, p99, ratio_of
from benchmarks.peers.recording import Matrices, Recording, record
from benchmarks.peers.standings import compare
from benchmarks.peers.tiers import TIERS
from rt_controller.control.solver import SolveStatus
from rt_controller.control.solvers import open_solver

EVENTS = 150
"""of a recording: enough for the first lane change to begin"""


@pytest.fixture(scope="module", params=["mdk-net", "mdk-net-paper"])
def recording(request) -> Recording:
    whole = record(request.param, "double_lane_change", TIERS["slew"])
    return replace(whole, events=whole.events[:EVENTS])


class Wrong:
    """Solves another problem; or says that it could not."""

    def __init__(self, program, tolerance, status=SolveStatus.SOLVED):
        self._program, self._status = program, status
        self._inner = open_solver(program)
        self.solution = np.zeros(program.size)

    def renew(self):
        return self._inner.renew()

    def solve(self):
        self._inner.solve()
        self.solution[:] = self._inner.solution
        self.solution[2] += 2.0 * EXACT_ENOUGH
        return self._status


def test_a_recording_is_the_drive_that_was_driven(recording):
    """The program at every tick is what the controller solved, in memory of its own."""
    ticks = [event for event in recording.events if not isinstance(event, Matrices)]
    assert any(event.is_rehearsal for event in ticks)
    assert not all(event.is_rehearsal for event in ticks)
    program = recording.copy()
    before = program.q.copy()
    list(recording.replay(program))
    assert not np.array_equal(program.q, before)
    assert np.array_equal(recording.copy().q, before)


def test_what_is_called_exact_meets_the_conditions_of_optimality(recording):
    exact = exact_first_inputs(recording)
    asked = [
        event
        for event in recording.events
        if not isinstance(event, Matrices) and not event.is_rehearsal
    ]
    assert exact.shape == (len(asked), 3)


def test_an_answer_that_is_none_has_an_error_that_is_seen(recording):
    program = recording.copy()
    solver = open_solver(program)
    list(recording.replay(program))
    solver.renew()
    assert solver.solve() is SolveStatus.SOLVED
    multipliers = np.zeros(program.bounds.shape[1])
    shifted = solver.solution + 1e-3
    assert optimality_error(program, shifted, multipliers) > CERTAIN


def test_only_the_ticks_own_problems_are_timed_and_answered(recording):
    exact = exact_first_inputs(recording)
    for mode in Mode:
        lap = drive_lap(OWN[0], 1e-6, recording, mode)
        assert len(lap.times_us) == len(lap.first_inputs) == len(exact)
        assert lap.unsolved == 0
        assert first_input_error(lap, exact) <= EXACT_ENOUGH


def test_a_solver_that_is_wrong_or_gives_up_has_no_tolerance_that_is_exact_enough(recording):
    exact = exact_first_inputs(recording)
    wrong = Entrant("wrong", "numpy", Wrong, True)
    assert find_tolerance(wrong, recording, exact) is None
    unable = Entrant(
        "unable", "numpy", lambda p, t: Wrong(p, t, SolveStatus.ITERATION_LIMIT), False
    )
    assert find_tolerance(unable, recording, exact) is None
    assert find_tolerance(OWN[1], recording, exact) is not None


def test_standings_hold_everybody_against_the_default_and_against_cold_piqp(recording):
    wrong = Entrant("wrong", "numpy", Wrong, False)
    standings = {one.name: one for one in compare(recording, [*OWN, wrong], Mode.PREPARED, 2)}
    assert list(standings) == ["PIQP, warm", "PIQP", "DAQP", "wrong"]
    for name in ("PIQP, warm", "PIQP", "DAQP"):
        assert standings[name].is_exact_enough
        assert standings[name].unsolved == 0
    assert not standings["wrong"].is_exact_enough
    assert standings["PIQP"].p50_over_cold == (1.0, 1.0, 1.0)
    assert standings["PIQP, warm"].p50_over_default == (1.0, 1.0, 1.0)


def test_a_ratio_is_taken_within_a_round():
    """A machine that is slow for a whole round says nothing about either."""
    assert ratio_of([2.0, 20.0, 6.0], [1.0, 10.0, 2.0]) == (2.0, 2.0, 3.0)
    assert str(ratio_of([1.0], [3.0])) == "0.33 (0.33–0.33)"
    times = np.arange(1.0, 101.0)
    assert p50(times) == 50.5
    assert p99(times) == 100.0
