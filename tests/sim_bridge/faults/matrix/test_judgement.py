"""The rules of the matrix."""

import pytest

from rt_controller.contract.signals import Mode
from sim_bridge.faults.matrix.cases import Case
from sim_bridge.faults.matrix.row import MatrixRow, Observed, judge

GOOD = Observed(
    mode=Mode.NOMINAL,
    has_fault_bit=False,
    is_vehicle_braking=False,
    is_driven=True,
    is_faulty=False,
    ey_m=0.1,
    speed_mps=20.0,
    wanted_mps=20.0,
)
BAD = GOOD._replace(is_faulty=True)
STOPPED = BAD._replace(mode=Mode.SAFE_STOP, speed_mps=0.0)


def judged(*periods: Observed, failure: str | None = None, fault_free: bool = False) -> MatrixRow:
    case = Case("a", () if fault_free else ({"kind": "bus_off"},))
    return judge(case, 60.0, periods, failure)


def test_the_time_to_detection_counts_from_the_first_faulty_period() -> None:
    found = judged(*[GOOD] * 10, *[BAD] * 4, *[STOPPED] * 3)
    assert (found.detect_ms, found.mode, found.ok) == (100.0, "SAFE_STOP", True)


def test_the_times_to_both_stops_count_from_the_first_faulty_period() -> None:
    braking = STOPPED._replace(is_vehicle_braking=True)
    found = judged(GOOD, BAD, STOPPED, braking)
    assert (found.safe_stop_ms, found.vehicle_braking_ms) == (25.0, 50.0)
    assert judged(GOOD, BAD).safe_stop_ms is None


@pytest.mark.parametrize(
    "sign",
    [
        BAD._replace(has_fault_bit=True),
        BAD._replace(is_vehicle_braking=True),
        BAD._replace(mode=Mode.HOLD_PLAN),
        BAD._replace(mode=None),
        BAD._replace(mode=Mode.STANDBY),
    ],
)
def test_each_sign_of_a_fault_counts_as_detection(sign: Observed) -> None:
    assert judged(BAD, sign, STOPPED).detect_ms == 25.0


def test_a_fault_that_changes_nothing_is_harmless() -> None:
    found = judged(GOOD, *[BAD] * 100)
    assert (found.detect_ms, found.ok, found.reasons) == (None, True, ())


@pytest.mark.parametrize(
    ("periods", "reason"),
    [
        ([BAD._replace(ey_m=1.2)] * 5, "not detected in time"),
        ([BAD._replace(speed_mps=24.0)] * 5, "not detected in time"),
        ([*[BAD._replace(ey_m=1.2)] * 21, STOPPED], "not detected in time"),
        ([STOPPED._replace(ey_m=-1.8)], "left the lane"),
        ([*[BAD._replace(ey_m=-1.1, has_fault_bit=True)] * 13, STOPPED], "driven on far"),
        ([STOPPED._replace(speed_mps=3.0)], "not brought to rest"),
    ],
)
def test_a_drive_that_breaks_a_rule_is_not_ok(periods: list[Observed], reason: str) -> None:
    found = judged(*periods)
    assert not found.ok
    assert any(each.startswith(reason.split(" far", maxsplit=1)[0]) for each in found.reasons)


def test_the_failure_of_a_program_is_not_ok() -> None:
    assert judged(STOPPED, failure="it failed").reasons == ("it failed",)


def test_a_report_without_a_fault_is_a_false_alarm() -> None:
    assert not judged(GOOD, GOOD._replace(has_fault_bit=True), GOOD, fault_free=True).ok
    assert judged(GOOD, GOOD, fault_free=True).ok


def test_a_controller_has_to_detect_a_car_that_does_not_follow_its_commands() -> None:
    waiting = BAD._replace(is_driven=False)
    assert judged(waiting._replace(mode=Mode.STANDBY), *[waiting] * 60).reasons == (
        "not detected in time",
    )
    assert judged(waiting, waiting._replace(mode=Mode.SAFE_STOP)).ok
