"""The comparison of solvers certifies exact solutions and times only the problem of each tick."""

from functools import cache
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

pytest.importorskip("qpsolvers", reason="the extra [peers] is not installed")

from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.peers import solver_comparison
from benchmarks.peers.recording import TIERS, Matrices, Recording, record
from benchmarks.peers.solver_comparison import (
    ACCEPTED_ERROR,
    Mode,
    compare,
    exact_first_inputs,
    find_tolerance,
    first_input_error,
    run_solver,
)
from benchmarks.peers.solvers.registry import OWN, SolverEntry, find_solvers
from benchmarks.tables import Ratio, percentiles, summarise, to_tables
from rt_controller.control.program import SolveStatus
from rt_controller.control.warm_start import open_solver
from rt_controller.report.table import print_table


@pytest.fixture(scope="module", params=["mdk-net", "mdk-net-paper"])
def recording(request) -> Recording:
    return record(request.param, SHORT_LANE_CHANGE, TIERS["slew"])


@cache
def first_problems(tier: str) -> Recording:
    whole = record("mdk-net", SHORT_LANE_CHANGE, TIERS[tier])
    return Recording(whole.model, whole.scenario, whole.program, whole.events[:20])


class WrongSolver:
    """Default solver whose third input is wrong by twice the accepted error."""

    def __init__(self, program, tolerance, status=SolveStatus.SOLVED):
        self._status = status
        self._solver = open_solver(program)
        self.solution = np.zeros(program.size)

    def update_matrices(self):
        return self._solver.update_matrices()

    def solve(self):
        self._solver.solve()
        self.solution[:] = self._solver.solution
        self.solution[2] += 2.0 * ACCEPTED_ERROR
        return self._status


def test_a_recording_has_warm_ups_and_ticks_and_does_not_change_when_replayed(recording):
    problems = [event for event in recording.events if not isinstance(event, Matrices)]
    assert {event.is_warm_up for event in problems} == {True, False}
    program, q = recording.program.copy(), recording.program.q.copy()
    list(recording.replay(program))
    assert not np.array_equal(program.q, q)
    assert np.array_equal(recording.program.q, q)


def test_a_solution_that_is_not_certified_is_refused(recording, monkeypatch):
    monkeypatch.setattr(solver_comparison, "KKT_TOLERANCE", 0.0)
    with pytest.raises(solver_comparison.UncertainError, match="problem 0: expected a solution"):
        exact_first_inputs(recording)


def test_only_the_problem_of_each_tick_is_timed(recording):
    first_inputs = exact_first_inputs(recording)
    problems = [event for event in recording.events if not isinstance(event, Matrices)]
    assert first_inputs.shape == (sum(not event.is_warm_up for event in problems), 3)
    for mode in Mode:
        run = run_solver(OWN[0], 1e-6, recording, mode)
        assert len(run.times_us) == len(run.first_inputs) == len(first_inputs)
        assert run.unsolved == 0
        assert first_input_error(run, first_inputs) <= ACCEPTED_ERROR


def test_a_solver_that_is_wrong_or_fails_has_no_accepted_tolerance(recording):
    first_inputs = exact_first_inputs(recording)
    wrong = SolverEntry("wrong", "numpy", WrongSolver, True)
    assert find_tolerance(wrong, recording, first_inputs) is None
    failing = SolverEntry(
        "failing", "numpy", lambda p, t: WrongSolver(p, t, SolveStatus.ITERATION_LIMIT), False
    )
    assert find_tolerance(failing, recording, first_inputs) is None
    assert find_tolerance(OWN[1], recording, first_inputs) is not None


def test_results_are_ratios_to_the_default_and_to_cold_piqp(recording):
    wrong = SolverEntry("wrong", "numpy", WrongSolver, False)
    results = compare(recording, [*OWN, wrong], Mode.PREPARED, 2)
    assert set(results.index) == {"PIQP, warm", "PIQP", "wrong"}
    assert not results.loc["wrong", "is_accurate"]
    own = results.drop(index="wrong")
    assert own.is_accurate.all()
    assert (own.unsolved == 0).all()
    assert (own.first_input_error <= ACCEPTED_ERROR).all()
    assert results.loc["PIQP", "p50_us_over_cold"] == (1.0, 1.0, 1.0)
    assert results.loc["PIQP, warm", "p50_us_over_default"] == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("entry", find_solvers()[0], ids=lambda entry: entry.name)
@pytest.mark.parametrize("tier", TIERS)
def test_every_installed_solver_is_accurate_with_some_tolerance(tier, entry):
    recording = first_problems(tier)
    assert find_tolerance(entry, recording, exact_first_inputs(recording)) is not None


def test_a_ratio_is_taken_within_a_round():
    """A slow round of the machine changes both figures, and not their ratio."""
    rounds = pd.DataFrame(
        {
            "round": [0, 0, 1, 1, 2, 2],
            "name": ["solver", "reference"] * 3,
            "p50_us": [2.0, 1.0, 20.0, 10.0, 6.0, 2.0],
        }
    )
    summary = summarise(rounds, ["p50_us"], {"reference": "reference"})
    assert summary.loc["solver", "p50_us"] == 6.0
    assert summary.loc["solver", "p50_us_over_reference"] == (2.0, 2.0, 3.0)
    assert percentiles(np.arange(1.0, 101.0)) == {"p50_us": 50.5, "p99_us": 100.0, "max_us": 100.0}


def test_the_tables_fit_into_80_columns_with_every_number_and_ratio():
    heads = solver_comparison.HEADS
    figures = sorted({figure for columns in heads.values() for figure in columns})
    one = {
        figure: Ratio(12.34, 9.87, 56.78) if "_over_" in figure else 12345.6 for figure in figures
    }
    named = pd.DataFrame([one], index=pd.Index(["PIQP with warm start, the default"], name="name"))
    file = StringIO()
    for table in to_tables("mdk-net, mild, slew, prepared", named, heads):
        print_table(table, Console(file=file, width=80))
    text = file.getvalue()
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("9.87–56.8") == sum("_over_" in figure for figure in figures)
    assert text.count("12300") == sum("_over_" not in figure for figure in figures)
