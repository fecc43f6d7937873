"""The faults of the matrix, and drives with some of them."""

import json
from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.bundle import Bundle
from sim_bridge.faults.kinds import KINDS
from sim_bridge.faults.matrix.cases import (
    CASES_FILE,
    CONDITIONS,
    SPEEDS_KMH,
    load_cases,
    whole_matrix,
)
from sim_bridge.faults.matrix.command import Task, fault_matrix, sample
from sim_bridge.faults.matrix.drive import drive_case

CASES = {case.name: case for case in load_cases()}


@pytest.fixture(scope="module")
def lti() -> Bundle:
    return Bundle.load("lti")


@pytest.mark.parametrize(
    ("file", "least"),
    [("cases", 80), ("variants", 60), ("bus_variants", 20), ("manoeuvre_variants", 45)],
)
def test_every_case_is_a_scenario_with_its_faults(file: str, least: int) -> None:
    cases = load_cases(CASES_FILE.with_name(f"{file}.toml"))
    assert len(cases) >= least
    assert file == "cases" or not {case.name for case in cases} & set(CASES)
    for case in cases:
        for speed_kmh in SPEEDS_KMH:
            assert len(case.scenario(speed_kmh).faults) == len(case.faults)
    kinds = {fault.kind for case in cases for fault in case.scenario(80.0).faults}
    assert file != "cases" or kinds == set(KINDS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[a]\nvalue = 1\n", "a.faults: expected a value"),
        ("[a]\nfaults = []\nmanoeuver = 1\n", "a.manoeuver: no such setting"),
        ('[a]\nmanoeuvre = "slalon"\nfaults = []\n', "did you mean slalom"),
        ("a = 1\n", "a: expected a table"),
        ("[a\n", "expected a TOML file"),
        ("", "at least 1"),
        (None, "expected a TOML file"),
    ],
)
def test_a_file_without_cases_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    path = tmp_path / "own.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_cases(path)
    assert str(path) in str(refused.value)
    assert message in str(refused.value)


@pytest.mark.parametrize(
    ("name", "mode", "detect_ms", "is_at_rest"),
    [
        ("none", "NOMINAL", None, False),
        ("state_lost", "SAFE_STOP", 0.0, True),
        ("mission_ends_falsely", "ENDED", 250.0, True),  # the car is followed alone
    ],
)
def test_a_drive_is_followed_to_its_end(
    lti: Bundle, name: str, mode: str, detect_ms: float | None, is_at_rest: bool
) -> None:
    found = drive_case(CASES[name], 60.0, lti)
    assert (found.mode, found.detect_ms, found.ok) == (mode, detect_ms, True)
    assert (found.final_speed_mps < 1.0) is is_at_rest


@pytest.mark.parametrize(
    ("only", "conditions", "message"),
    [
        (["state_lots"], [], "--only: .*did you mean state_lost"),
        (["none"], ["wet_s_bent"], "--conditions: .*did you mean wet_s_bend"),
    ],
)
def test_unknown_names_are_refused(only: list[str], conditions: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        fault_matrix("lti", only, [60.0], 1, None, conditions=conditions)


def test_a_car_with_a_late_steering_wheel_is_driven_to_the_end() -> None:
    found = drive_case(CASES["steering_late_100ms"], 80.0, load_bundle(find_model(None)))
    assert (found.mode, found.safe_stop_ms) == ("NOMINAL", None)
    assert found.max_ey_m < 0.3


def test_a_wheel_that_turns_to_the_wrong_side_is_detected_at_once_and_a_known_limit() -> None:
    cases = load_cases(CASES_FILE.with_name("manoeuvre_variants.toml"))
    (case,) = [each for each in cases if each.name == "steering_wrong_sign"]
    found = drive_case(case, 60.0, load_bundle(find_model(None)))
    assert found.detect_ms is not None
    assert found.detect_ms <= 50.0
    assert (found.mode, found.ok, found.is_open) == ("SAFE_STOP", False, False)
    assert found.max_ey_unchecked_m is not None, "it is driven without checks too"
    assert abs(found.max_ey_unchecked_m - found.max_ey_m) > 1.0


def test_the_whole_matrix_has_every_drift_under_every_condition() -> None:
    crossed = whole_matrix()[len(CASES) :]
    assert {case.condition for case in crossed} == set(CONDITIONS)
    assert len(crossed) == len(CONDITIONS) * len({case.name for case in crossed})
    for case in crossed:
        scenario = case.scenario(120.0)
        assert len(scenario.faults) == len(case.faults) + len(case.sensors)
        assert (scenario.payload.mass_kg > 0.0) is ("loaded" in case.condition)


def test_a_sample_has_every_kind_of_fault_and_every_condition() -> None:
    found = sample([Task(case, speed, None) for case in whole_matrix() for speed in SPEEDS_KMH])
    kinds = {str(fault["kind"]) for case, _, _ in found for fault in case.faults}
    assert kinds == {str(fault["kind"]) for case in whole_matrix() for fault in case.faults}
    assert {case.condition for case, _, _ in found} == {c.condition for c in whole_matrix()}
    assert {speed for _, speed, _ in found} == set(SPEEDS_KMH)
    assert len(found) <= 40


def test_an_interrupted_matrix_goes_on_after_the_drives_of_its_file(tmp_path: Path) -> None:
    path, drives = tmp_path / "matrix.json", tmp_path / "drives.jsonl"
    for names in (["none"], ["none", "none"]):
        assert fault_matrix("lti", names, [60.0], 1, path, drives_file=drives) == 0
    assert len(drives.read_text().splitlines()) == 1
    written = json.loads(path.read_text())
    assert [row["fault"] for row in written["rows"]] == ["none"]
    assert written["summary"]["drives_ok"] == 1
    with pytest.raises(ConfigError, match="expected drives of the model"):
        fault_matrix(None, ["none"], [60.0], 1, path, drives_file=drives)
