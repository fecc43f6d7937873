"""The matrix of faults: its cases, its drives, its rules and its summary."""

import json
import re
from pathlib import Path

import pytest

from benchmarks.fault_matrix.__main__ import Task, app, sample_of
from benchmarks.fault_matrix.cases import (
    CASES_FILE,
    CONDITIONS,
    SPEEDS_KMH,
    Case,
    load_cases,
    whole_matrix,
)
from benchmarks.fault_matrix.drive import drive_case
from benchmarks.fault_matrix.summary import summarise
from benchmarks.fault_matrix.verdict import MatrixRow, Observed, judge
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import Mode
from rt_controller.model.bundle import Bundle
from rt_controller.terminal.command_line import run_command
from sim_bridge.faults.fault import KINDS

CASES = {case.name: case for case in load_cases()}


@pytest.mark.parametrize(
    ("file", "least"),
    [("cases", 80), ("variants", 60), ("bus_variants", 20), ("manoeuvre_variants", 45)],
)
def test_every_case_is_a_scenario_with_its_faults(file, least):
    cases = load_cases(CASES_FILE.with_name(f"{file}.toml"))
    assert len(cases) >= least
    assert file == "cases" or not {case.name for case in cases} & set(CASES)
    for case in cases:
        for speed_kmh in SPEEDS_KMH:
            assert len(case.scenario(speed_kmh).faults) == len(case.faults)
    kinds = {fault.kind for case in cases for fault in case.scenario(80.0).faults}
    assert file != "cases" or kinds == set(KINDS)


@pytest.mark.parametrize(
    ("model", "speed_kmh", "name", "mode", "detect_ms", "is_at_rest"),
    [
        ("lti", 60.0, "none", "NOMINAL", None, False),
        ("lti", 60.0, "state_lost", "SAFE_STOP", 0.0, True),
        ("lti", 60.0, "mission_ends_falsely", "ENDED", 250.0, True),  # the car is followed alone
        ("mdk-net", 80.0, "steering_late_100ms", "NOMINAL", 75.0, False),
    ],
)
def test_a_drive_is_followed_to_its_end(model, speed_kmh, name, mode, detect_ms, is_at_rest):
    found = drive_case(CASES[name], speed_kmh, Bundle.load(model))
    assert (found.mode, found.detect_ms, found.ok) == (mode, detect_ms, True)
    assert (found.final_speed_mps < 1.0) is is_at_rest
    assert is_at_rest or found.max_ey_m < 0.3


@pytest.mark.nightly
def test_a_wheel_that_turns_to_the_wrong_side_is_detected_at_once_and_a_known_limit():
    cases = load_cases(CASES_FILE.with_name("manoeuvre_variants.toml"))
    (case,) = [each for each in cases if each.name == "steering_wrong_sign"]
    found = drive_case(case, 60.0, Bundle.load(None))
    assert found.detect_ms <= 50.0
    assert (found.mode, found.ok, found.is_open) == ("SAFE_STOP", False, False)
    assert abs(found.max_ey_unchecked_m - found.max_ey_m) > 1.0


def test_the_whole_matrix_has_every_drift_under_every_condition():
    crossed = whole_matrix()[len(CASES) :]
    assert {case.condition for case in crossed} == set(CONDITIONS)
    assert len(crossed) == len(CONDITIONS) * len({case.name for case in crossed})
    for case in crossed:
        scenario = case.scenario(120.0)
        assert len(scenario.faults) == len(case.faults) + len(case.sensors)
        assert (scenario.payload.mass_kg > 0.0) is ("loaded" in case.condition)


def test_a_sample_has_every_kind_of_fault_and_every_condition():
    found = sample_of([Task(case, speed) for case in whole_matrix() for speed in SPEEDS_KMH])
    kinds = {str(fault["kind"]) for case, _ in found for fault in case.faults}
    assert kinds == {str(fault["kind"]) for case in whole_matrix() for fault in case.faults}
    assert {case.condition for case, _ in found} == {c.condition for c in whole_matrix()}
    assert {speed for _, speed in found} == set(SPEEDS_KMH)
    assert len(found) <= 40


def run(*arguments: str) -> object:
    with pytest.raises(SystemExit) as ended:
        run_command(app, ("--model", "lti", "--speed-kmh", "60", "--jobs", "1", *arguments))
    return ended.value.code


def test_a_matrix_repeats_no_drive_of_its_file(tmp_path):
    path, drives = tmp_path / "matrix.json", tmp_path / "drives.jsonl"
    for _ in range(2):
        assert run("--only", "none", "--json", str(path), "--drives", str(drives)) == 0
        assert len(drives.read_text().splitlines()) == 1
    written = json.loads(path.read_text())
    assert [row["fault"] for row in written["rows"]] == ["none"]
    assert written["summary"]["drives_ok"] == 1


GUIDE = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")


def test_the_guide_has_every_figure_and_its_example_is_a_file_of_cases(tmp_path):
    for name in MatrixRow._fields:
        assert re.search(rf"\b{name}\b", GUIDE), name
    file = tmp_path / "cases.toml"
    file.write_text(re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)[1], encoding="utf-8")
    for case in load_cases(file):
        assert case.scenario(60.0).faults or case.initial


GOOD = Observed(Mode.NOMINAL, False, False, True, False, ey_m=0.1, speed_mps=20.0, wanted_mps=20.0)
BAD = GOOD._replace(is_faulty=True)
WAITING = BAD._replace(is_driven=False)
STOPPED = BAD._replace(mode=Mode.SAFE_STOP, speed_mps=0.0)


def judged(*periods, failure=None, fault_free=False, unchecked_m=None):
    case = Case(faults=() if fault_free else ({"kind": "bus_off"},))
    return judge(case, 60.0, periods, failure, unchecked_m)


ROW = MatrixRow(
    fault="state_lost", speed_mps=22.222, mode="SAFE_STOP", detect_ms=25.0, max_ey_m=0.5, ok=True,
    nominal_far_s=0.0, max_speed_error_mps=0.1, final_speed_mps=0.2, safe_stop_ms=75.0,
    vehicle_braking_ms=None, manoeuvre="lane_change", reasons=(), known_limit="",
)  # fmt: skip
DEAD = ROW._replace(fault="controller_silent", detect_ms=None, vehicle_braking_ms=100.0)
OPEN = ROW._replace(fault="a", ok=False, max_ey_m=1.8, reasons=("left the lane",))
LIMIT = OPEN._replace(fault="b", max_ey_m=4.0, known_limit="only the brake is left")


def test_the_summary_counts_drives_by_detection_and_known_limits():
    late, missed = ROW._replace(detect_ms=700.0), ROW._replace(detect_ms=None)
    none = missed._replace(fault="none", is_fault_free=True)
    assert summarise([ROW, DEAD, OPEN, LIMIT])[:4] == (4, 2, 1, 1)
    assert summarise([ROW, LIMIT]).max_ey_m == 0.5, "a known limit does not hide the others"
    found = summarise([ROW, late, late._replace(ok=False), missed, none])
    assert (found.drives_detected, found.drives_detected_late) == (1, 1)
    assert (found.drives_harmless, found.drives_without_fault) == (1, 1)
    found = summarise([ROW, ROW._replace(detect_ms=0.0), DEAD])
    assert (found.state_loss_flagged_ms, found.state_loss_safe_stop_ms) == (25.0, 75.0)
    assert found.dead_controller_braking_ms == 100.0
    assert summarise([ROW, ROW._replace(safe_stop_ms=None)]).state_loss_safe_stop_ms is None


@pytest.mark.parametrize(
    ("periods", "detect_ms", "reason"),
    [
        ([GOOD] * 10 + [BAD] * 4 + [STOPPED] * 3, 100.0, None),
        ([BAD, BAD._replace(has_fault_bit=True), STOPPED], 25.0, None),
        ([BAD, BAD._replace(is_vehicle_braking=True), STOPPED], 25.0, None),
        *(([BAD, BAD._replace(mode=mode), STOPPED], 25.0, None)
          for mode in (Mode.HOLD_PLAN, Mode.STANDBY, None)),
        ([GOOD] + [BAD] * 100, None, None),  # harmless
        ([WAITING._replace(mode=Mode.STANDBY)] + [WAITING] * 60, None, "not detected in time"),
        ([WAITING, WAITING._replace(mode=Mode.SAFE_STOP)], 25.0, None),
        ([BAD._replace(ey_m=1.2)] * 5, None, "not detected in time"),
        ([BAD._replace(speed_mps=24.0)] * 5, None, "not detected in time"),
        ([BAD._replace(ey_m=1.2)] * 21 + [STOPPED], 525.0, "not detected in time"),
        ([STOPPED._replace(ey_m=-1.8)], 0.0, "left the lane"),
        ([BAD._replace(ey_m=-1.1, has_fault_bit=True)] * 13 + [STOPPED], 0.0, "driven on far"),
        ([STOPPED._replace(speed_mps=3.0)], 0.0, "not brought to rest"),
    ],
)  # fmt: skip
def test_a_drive_is_judged_by_its_detection_and_where_it_went(periods, detect_ms, reason):
    """The time of detection counts from the first faulty period."""
    found = judged(*periods)
    assert (found.detect_ms, found.ok) == (detect_ms, reason is None)
    assert reason is None or any(each.startswith(reason) for each in found.reasons)


def test_failures_false_alarms_and_harmful_checks_are_not_ok():
    found = judged(GOOD, BAD, STOPPED, STOPPED._replace(is_vehicle_braking=True))
    assert (found.safe_stop_ms, found.vehicle_braking_ms) == (25.0, 50.0)
    assert judged(GOOD, BAD).safe_stop_ms is None
    assert judged(STOPPED, failure="it failed").reasons == ("it failed",)
    assert judged(GOOD, GOOD, fault_free=True).ok
    assert not judged(GOOD, GOOD._replace(has_fault_bit=True), GOOD, fault_free=True).ok
    for unchecked_m, reasons in (
        (0.29, ("worse than without checks by 0.21 m",)), (0.31, ()), (None, ()),
    ):  # fmt: skip
        row = judged(BAD._replace(ey_m=0.5), STOPPED, unchecked_m=unchecked_m)
        assert row.reasons == reasons


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("[a]\nvalue = 1\n", "a.faults"),
        ("[a]\nfaults = []\nmanoeuver = 1\n", "a.manoeuver"),
        ('[a]\nmanoeuvre = "slalon"\nfaults = []\n', "a.manoeuvre"),
        ("", ""),
        (None, ""),
    ],
)
def test_a_file_without_cases_is_refused(tmp_path, text, field):
    path = tmp_path / "own.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_cases(path)
    assert str(path) in str(refused.value)
    assert field in str(refused.value)


@pytest.mark.parametrize(
    "arguments", [("--only", "state_lots"), ("--conditions", "wet_s_bent"), ("--speed-kmh", "0")]
)
def test_unknown_names_and_speeds_are_refused(arguments, capsys):
    assert run(*arguments) == 2
    assert arguments[0] in capsys.readouterr().err
