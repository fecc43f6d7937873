"""The rules of the matrix."""

import pytest

from rt_controller.contract.signals import Mode
from sim_bridge.faults.matrix.cases import Case
from sim_bridge.faults.matrix.row import MatrixRow, Observed, judge

GOOD = Observed(Mode.NOMINAL, False, False, True, False, ey_m=0.1, speed_mps=20.0, wanted_mps=20.0)
BAD = GOOD._replace(is_faulty=True)
STOPPED = BAD._replace(mode=Mode.SAFE_STOP, speed_mps=0.0)


def judged(
    *periods: Observed,
    failure: str | None = None,
    fault_free: bool = False,
    unchecked_m: float | None = None,
) -> MatrixRow:
    case = Case(faults=() if fault_free else ({"kind": "bus_off"},))
    return judge(case, 60.0, periods, failure, unchecked_m)


def test_the_time_to_detection_counts_from_the_first_faulty_period() -> None:
    found = judged(*[GOOD] * 10, *[BAD] * 4, *[STOPPED] * 3)
    assert (found.detect_ms, found.mode, found.ok) == (100.0, "SAFE_STOP", True)


def test_the_times_to_both_stops_count_from_the_first_faulty_period() -> None:
    found = judged(GOOD, BAD, STOPPED, STOPPED._replace(is_vehicle_braking=True))
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
    assert any(each.startswith(reason) for each in found.reasons)


def test_a_fault_that_changes_nothing_is_harmless_and_a_failure_or_false_alarm_is_not() -> None:
    found = judged(GOOD, *[BAD] * 100)
    assert (found.detect_ms, found.ok, found.reasons) == (None, True, ())
    assert judged(STOPPED, failure="it failed").reasons == ("it failed",)
    assert judged(GOOD, GOOD, fault_free=True).ok
    assert not judged(GOOD, GOOD._replace(has_fault_bit=True), GOOD, fault_free=True).ok


def test_a_controller_has_to_detect_a_car_that_does_not_follow_its_commands() -> None:
    waiting = BAD._replace(is_driven=False)
    assert judged(waiting._replace(mode=Mode.STANDBY), *[waiting] * 60).reasons == (
        "not detected in time",
    )
    assert judged(waiting, waiting._replace(mode=Mode.SAFE_STOP)).ok


@pytest.mark.parametrize(("unchecked_m", "is_ok"), [(0.29, False), (0.31, True), (None, True)])
def test_a_drive_that_is_worse_than_without_checks_is_not_ok(
    unchecked_m: float | None, is_ok: bool
) -> None:
    row = judged(BAD._replace(ey_m=0.5), STOPPED, unchecked_m=unchecked_m)
    assert row.ok is is_ok
    assert is_ok or row.reasons == ("worse than without checks by 0.21 m",)
