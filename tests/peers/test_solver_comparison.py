"""The comparison of solvers certifies exact solutions and times only the problem of each tick."""

from functools import cache

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("qpsolvers", reason="the extra [peers] is not installed")

from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.peers import __main__ as peers
from benchmarks.peers import comparison
from benchmarks.peers.comparison import (
    ACCEPTED_ERROR,
    compare,
    exact_first_inputs,
    find_tolerance,
    run_solver,
    summarise,
)
from benchmarks.peers.recording import TIERS, Matrices, Recording, record
from benchmarks.peers.solvers import COLD, DEFAULT, OWN, SolverEntry, find_solvers
from rt_controller.control.program import SolveStatus
from rt_controller.control.warm_start import open_solver
from rt_controller.terminal.command_line import run_command


@cache
def recorded(model: str, tier: str, count: int | None = None) -> Recording:
    whole = record(model, SHORT_LANE_CHANGE, TIERS[tier])
    return Recording(whole.model, whole.scenario, whole.program, whole.events[:count])


@pytest.fixture(params=["mdk-net", "mdk-net-paper"])
def recording(request) -> Recording:
    return recorded(request.param, "slew")


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


def test_a_solution_that_is_not_certified_is_refused(recording, monkeypatch):
    monkeypatch.setattr(comparison, "KKT_TOLERANCE", 0.0)
    with pytest.raises(comparison.UncertainError, match="problem 0: expected a solution"):
        exact_first_inputs(recording)


def test_only_the_problem_of_each_tick_is_timed(recording):
    first_inputs = exact_first_inputs(recording)
    problems = [event for event in recording.events if not isinstance(event, Matrices)]
    assert {event.is_warm_up for event in problems} == {True, False}
    assert first_inputs.shape == (sum(not event.is_warm_up for event in problems), 3)
    run = run_solver(OWN[0], 1e-6, recording)
    assert len(run.times_us) == len(run.first_inputs) == len(first_inputs)
    assert run.unsolved == 0
    assert run.error(first_inputs) <= ACCEPTED_ERROR


@pytest.mark.parametrize("status", [SolveStatus.SOLVED, SolveStatus.ITERATION_LIMIT])
def test_a_solver_that_is_wrong_or_fails_has_no_accepted_tolerance(status):
    recording = recorded("mdk-net", "slew")
    entry = SolverEntry("wrong", "numpy", lambda p, t: WrongSolver(p, t, status), True)
    assert find_tolerance(entry, recording, exact_first_inputs(recording)) is None


def test_results_are_ratios_to_the_default_and_to_cold_piqp():
    wrong = SolverEntry("wrong", "numpy", WrongSolver, False)
    found = compare(recorded("mdk-net", "slew"), [*OWN, wrong], 2)
    assert set(found) == {DEFAULT, COLD, "wrong"}
    assert not found["wrong"]["is_accurate"]
    for name in (DEFAULT, COLD):
        assert found[name]["is_accurate"]
        assert found[name]["unsolved"] == 0
        assert found[name]["first_input_error"] <= ACCEPTED_ERROR
    assert set(found[COLD]["p50_us_over_cold"].values()) == {1.0}


@pytest.mark.parametrize("entry", find_solvers()[0], ids=lambda entry: entry.name)
@pytest.mark.parametrize("tier", TIERS)
def test_every_installed_solver_is_accurate_with_some_tolerance(tier, entry):
    recording = recorded("mdk-net", tier, 20)
    assert find_tolerance(entry, recording, exact_first_inputs(recording)) is not None


def test_a_ratio_is_taken_within_a_round():
    """A slow round of the machine changes both figures, and not their ratio."""
    times = {COLD: (1.0, 10.0, 2.0), DEFAULT: (1.0, 1.0, 1.0), "solver": (2.0, 20.0, 6.0)}
    rows = [
        (round_, name, each[round_], each[round_], 9.0, 0.0, 0)
        for name, each in times.items()
        for round_ in range(3)
    ]
    names = ["round", "name", "p50_us", "p99_us", "max_us", "first_input_error", "unsolved"]
    found = summarise(pd.DataFrame(rows, columns=names))["solver"]
    assert found["p50_us"] == 6.0
    assert found["p50_us_over_cold"] == {"median": 2.0, "least": 2.0, "most": 3.0}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--plot", "times.tif"), "one of .png, .svg, .pdf"),
        (("--tiers", "slow"), '--tiers. Choose from: "slew", "corridor"'),
        (("--only", "OQSP"), "(did you mean OSQP?)"),
    ],
)
def test_a_wrong_name_or_path_is_refused_at_once(arguments, expected, capsys):
    with pytest.raises(SystemExit) as ended:
        run_command(peers.app, arguments)
    assert ended.value.code == 2
    assert expected in capsys.readouterr().err
