"""The summary of a matrix."""

from sim_bridge.faults.matrix.row import MatrixRow
from sim_bridge.faults.matrix.summary import lines_of, summarise

GOOD = MatrixRow(
    fault="state_lost", speed_mps=22.222, mode="SAFE_STOP", detect_ms=25.0, max_ey_m=0.5, ok=True,
    nominal_far_s=0.0, max_speed_error_mps=0.1, final_speed_mps=0.2, safe_stop_ms=75.0,
    vehicle_braking_ms=None, manoeuvre="lane_change", reasons=(), known_limit="",
)  # fmt: skip
DEAD = GOOD._replace(fault="controller_silent", detect_ms=None, vehicle_braking_ms=100.0)
OPEN = GOOD._replace(fault="a", ok=False, max_ey_m=1.8, reasons=("left the lane",))
LIMIT = OPEN._replace(fault="b", max_ey_m=4.0, known_limit="only the brake is left")


def test_drives_that_are_not_ok_are_counted_with_and_without_a_documented_reason() -> None:
    found = summarise([GOOD, DEAD, OPEN, LIMIT])
    assert (found.drives_detected, found.drives_harmless) == (3, 1)
    assert lines_of(found)[0] == ("2 of 4 drives are ok; not ok: 1 with a known limit, 1 others")
    assert summarise([GOOD, LIMIT]).max_ey_m == 0.5, "a known limit does not hide the others"


def test_a_fault_that_is_detected_late_and_a_drive_without_one_are_counted_apart() -> None:
    late = GOOD._replace(fault="ey_drift", detect_ms=700.0)
    missed = GOOD._replace(fault="small", detect_ms=None)
    none = missed._replace(fault="none", is_fault_free=True)
    assert lines_of(summarise([GOOD, late, late._replace(ok=False), missed, none]))[1] == (
        "detected within 0.5 s: 1; harmless and detected later: 1; harmless and not detected: 1; "
        "without a fault: 1"
    )


def test_the_times_of_reaction_are_the_latest_and_absent_if_one_drive_lacks_them() -> None:
    found = summarise([GOOD, GOOD._replace(detect_ms=0.0), DEAD])
    assert (found.state_loss_flagged_ms, found.state_loss_safe_stop_ms) == (25.0, 75.0)
    assert "dead controller to braking 100 ms (limit 100)" in lines_of(found)[-1]
    assert summarise([GOOD, GOOD._replace(safe_stop_ms=None)]).state_loss_safe_stop_ms is None
    assert len(lines_of(summarise([OPEN]))) == 3
