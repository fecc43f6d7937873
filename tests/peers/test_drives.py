"""Figures of many drives: times of the step, and stops of cars without a fault."""

import numpy as np
import pytest

from benchmarks import cadence, false_alarms
from benchmarks.conditions import conditions
from benchmarks.false_alarms import DriveResult, figures_of
from rt_controller.contract.quantities import Quantity
from rt_controller.realtime.timing import TickTimes
from rt_controller.terminal.command_line import run_command
from sim_bridge.scenario import load_scenario


def run(app, *arguments: str) -> object:
    with pytest.raises(SystemExit) as ended:
        run_command(app, arguments)
    return ended.value.code or 0


def driven_run(ending, misses, late_us, step_us, qp_iterations=1.0):
    fields = ("tick", *TickTimes._fields)
    ticks = np.zeros(len(step_us), dtype=[(name, float) for name in fields])
    ticks["step_us"] = ticks["qp_us"] = step_us
    ticks["qp_iterations"] = qp_iterations
    summary = {
        "model": "made",
        "scheduler": "SCHED_FIFO 50",
        "memory_locked": True,
        "ending": ending,
        "deadline_misses": misses,
        "skipped_ticks": 2 * misses,
        "worst_tick": {"tick": 3, "late_us": late_us, "cause": "HOST"},
    }
    return cadence.CadenceRun(summary, ticks)


def test_figures_are_of_all_ticks_of_all_drives():
    found = cadence.aggregate(
        [
            driven_run("SAFE_STOPPED", 1, 90_000.0, [100.0] * 30),
            driven_run("MISSION_OVER", 2, 800.0, [400.0]),
            driven_run("MISSION_OVER", 0, 700.0, [900.0] * 20, qp_iterations=0.0),
        ]
    )
    assert (found["ticks"], found["drives"], found["safe_stops"]) == (51, 3, 1)
    assert (found["deadline_misses"], found["skipped_ticks"]) == (3, 6)
    assert found["worst_tick"]["late_us"] == 90_000.0
    assert found["step_us"]["p50"] == pytest.approx(100.0, rel=0.01)
    assert found["step_us"]["max"] == 900.0
    assert found["step_us"]["mean"] == pytest.approx((30 * 100 + 400 + 20 * 900) / 51)
    assert found["qp_us"]["max"] == 400.0  # the last drive solved nothing


def test_the_drive_of_the_cadence_has_so_many_ticks_and_changes_its_lane(tmp_path):
    cadence.write_slalom(tmp_path / "slalom.toml", 1000)
    assert load_scenario(str(tmp_path / "slalom.toml")).duration_s == 25.0


CONDITION = next(conditions(["straight"]))


def driven(
    unchecked_m: float | None,
    *failed: str,
    progress_m: float = 0.0,
    rival_m: float | None = None,
) -> DriveResult:
    largest = {q.name.lower(): 0.0 for q in Quantity} | {"progress_step_m": progress_m}
    return DriveResult(CONDITION, 3600.0, 0.1, unchecked_m, rival_m, failed, largest)


@pytest.mark.parametrize(
    ("result", "false_checks", "is_lost"),
    [
        (driven(None), (), False),
        (driven(0.5, "heading"), ("heading",), False),
        (driven(0.91, "heading", "tracking"), (), True),
        (driven(None, "heading"), ("heading",), False),
    ],
    ids=["no check failed", "keeps its path", "leaves its path", "unchecked drive had no end"],
)
def test_a_stop_is_right_if_the_car_leaves_its_path_without_checks_too(
    result, false_checks, is_lost
):
    assert result.false_checks == false_checks
    assert result.has_lost_path is is_lost


def test_cars_that_lose_their_path_are_counted_apart():
    drives = [driven(None, progress_m=0.005)]
    drives += [driven(3.0, "progress", progress_m=1.0, rival_m=0.1)]
    drives += [driven(0.1, "progress", progress_m=0.03)]
    figures = figures_of(drives)
    row = next(row for row in figures["checks"] if row["check"] == "progress")
    assert (row["largest"], row["drives_with_false_alarm"]) == (0.03, 1)
    assert row["false_alarms_per_h"] == pytest.approx(1.0 / 3.0)
    assert figures["drives"] == 3
    assert figures["drives_with_false_alarm"] == 1
    assert figures["drives_that_lose_the_path_without_checks_too"] == 1
    assert figures["drives_that_lose_the_path_where_stanley_keeps_it"] == 1


def test_false_alarms_are_counted_in_the_drives_of_a_file_and_in_new_ones(tmp_path, capsys):
    file = tmp_path / "drives.jsonl"
    options = ("--scenarios", "straight", "--hours", "1e-6", "--drives", str(file), "--jobs", "1")
    assert run(false_alarms.app, *options) == 0
    lines = file.read_text()
    assert run(false_alarms.app, *options) == 0
    assert file.read_text() == lines
    assert "0 with a false alarm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--variants", "fats"), '--variants. Choose from: "default", "unprepared"'),
        (("--json", "/no-such-folder/figures.json"), "--json /no-such-folder"),
    ],
)
def test_a_wrong_name_or_path_is_refused_at_once(arguments, expected, capsys):
    assert run(cadence.app, *arguments) == 2
    assert expected in capsys.readouterr().err
