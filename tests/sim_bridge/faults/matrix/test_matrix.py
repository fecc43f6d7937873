"""The faults of the matrix, and drives with some of them."""

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.model.artifact import find_model, load_bundle
from rt_controller.contract.model.bundle import Bundle
from sim_bridge.faults.kinds import KINDS
from sim_bridge.faults.matrix.cases import MANOEUVRES, SPEEDS_KMH, Case, load_cases, whole_matrix
from sim_bridge.faults.matrix.command import Task, fault_matrix, sample
from sim_bridge.faults.matrix.drive import drive_case

VARIANTS = Path(str(resources.files("sim_bridge.faults.matrix"))) / "variants.toml"
BUS_VARIANTS = VARIANTS.with_name("bus_variants.toml")
MANOEUVRE_VARIANTS = VARIANTS.with_name("manoeuvre_variants.toml")
CASES = {case.name: case for case in load_cases()}


@pytest.fixture(scope="module")
def lti() -> Bundle:
    return Bundle.load("lti")


def test_there_are_enough_faults_and_each_kind_is_among_them() -> None:
    faulty = [case for case in CASES.values() if not case.is_fault_free]
    assert len(faulty) >= 45
    kinds = {fault.base for case in faulty for fault in case.scenario(80.0).faults}
    assert kinds == set(KINDS)


@pytest.mark.parametrize(
    ("file", "least"), [(VARIANTS, 60), (BUS_VARIANTS, 20), (MANOEUVRE_VARIANTS, 45)]
)
def test_the_variants_are_cases_with_names_of_their_own(file: Path, least: int) -> None:
    variants = load_cases(file)
    assert len(variants) >= least
    assert not {case.name for case in variants} & set(CASES)
    for case in variants:
        assert len(case.scenario(80.0).faults) == len(case.faults)


@pytest.mark.parametrize("text", ["[a]\nvalue = 1\n", "a = 1\n", "[a\n", ""])
def test_a_file_without_cases_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"own\.toml.*expected"):
        load_cases(path)


def test_an_unknown_manoeuvre_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text('[a]\nmanoeuvre = "slalon"\nfaults = []\n')
    with pytest.raises(ConfigError, match=r"manoeuvre.*did you mean slalom"):
        load_cases(path)


@pytest.mark.parametrize("speed_kmh", SPEEDS_KMH)
def test_every_manoeuvre_is_a_scenario_with_its_fault(speed_kmh: float) -> None:
    fault = {"kind": "bus_off", "duration_s": 0.1}
    for name in MANOEUVRES:
        scenario = Case("a", (fault,), manoeuvre=name).scenario(speed_kmh)
        assert len(scenario.faults) == 1


@pytest.mark.parametrize("speed_kmh", SPEEDS_KMH)
def test_every_case_is_a_scenario(speed_kmh: float) -> None:
    for case in CASES.values():
        scenario = case.scenario(speed_kmh)
        assert len(scenario.faults) == len(case.faults)


def row(lti: Bundle, case: Case):  # type: ignore[no-untyped-def]
    return drive_case(case, 60.0, lti)


def test_a_drive_without_a_fault_is_ok(lti: Bundle) -> None:
    found = row(lti, CASES["none"])
    assert (found.mode, found.detect_ms, found.ok) == ("NOMINAL", None, True)


def test_a_lost_state_is_detected_at_once_and_the_car_is_followed_to_rest(lti: Bundle) -> None:
    found = row(lti, CASES["state_lost"])
    assert found.detect_ms == 0.0
    assert found.final_speed_mps < 1.0


def test_the_car_is_followed_after_the_controller_has_ended(lti: Bundle) -> None:
    found = row(lti, CASES["mission_ends_falsely"])
    assert found.final_speed_mps < 1.0


def test_the_rows_are_written_to_json(tmp_path: Path) -> None:
    path = tmp_path / "matrix.json"
    code = fault_matrix("lti", ["none"], [60.0], 1, path)
    written = json.loads(path.read_text())
    (found,) = written["rows"]
    assert code == 0
    assert {"fault", "speed_mps", "mode", "detect_ms", "max_ey_m", "ok"} <= set(found)
    assert written["summary"]["drives_ok"] == 1


def test_an_unknown_fault_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean state_lost"):
        fault_matrix("lti", ["state_lots"], [60.0], 1, None)


def test_a_drive_without_checks_has_no_reaction_to_a_wrong_value(lti: Bundle) -> None:
    case = CASES["ey_bias_1m"]
    assert drive_case(case, 60.0, lti).mode == "SAFE_STOP"
    assert drive_case(case, 60.0, lti, has_checks=False).mode == "NOMINAL"


@pytest.mark.parametrize("name", ["steering_late_50ms", "steering_late_100ms"])
def test_a_car_with_a_late_steering_wheel_is_driven_to_the_end(name: str) -> None:
    found = drive_case(CASES[name], 80.0, load_bundle(find_model(None)))
    assert (found.mode, found.safe_stop_ms) == ("NOMINAL", None)
    assert found.max_ey_m < 0.3


def test_a_wheel_that_turns_to_the_wrong_side_is_detected_at_once_and_a_known_limit() -> None:
    (case,) = [c for c in load_cases(MANOEUVRE_VARIANTS) if c.name == "steering_wrong_sign"]
    found = drive_case(case, 60.0, load_bundle(find_model(None)))
    assert found.detect_ms is not None
    assert found.detect_ms <= 50.0
    assert (found.mode, found.ok, found.is_open) == ("SAFE_STOP", False, False)


def test_the_whole_matrix_has_every_drift_under_every_condition() -> None:
    crossed = whole_matrix()[len(CASES) :]
    conditions = {case.condition for case in crossed}
    assert {"s_bend", "wet_s_bend", "wet_s_bend_loaded", "wet_s_bend_noisy"} <= conditions
    assert len(crossed) == len(conditions) * len({case.name for case in crossed})
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
        fault_matrix("lti", names, [60.0], 1, path, drives_file=drives)
    assert len(drives.read_text().splitlines()) == 1
    assert len(json.loads(path.read_text())["rows"]) == 1
    with pytest.raises(ConfigError, match="expected drives of the model"):
        fault_matrix(None, ["none"], [60.0], 1, path, drives_file=drives)


def test_an_unknown_condition_is_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean wet_s_bend"):
        fault_matrix("lti", ["none"], [60.0], 1, None, conditions=["wet_s_bent"])


@pytest.mark.parametrize(("unchecked_m", "is_ok"), [(0.29, False), (0.31, True), (None, True)])
def test_a_drive_that_is_worse_than_without_checks_is_not_ok(
    lti: Bundle, unchecked_m: float | None, is_ok: bool
) -> None:
    good = replace(drive_case(CASES["none"], 60.0, lti), max_ey_m=0.5)
    row = good.beside(unchecked_m)
    assert row.ok is is_ok
    assert is_ok or row.reasons[-1] == "worse than without checks by 0.21 m"
