"""Which signal is faulty for which residuals."""

import pytest

from rt_controller.contract.faults import StopCause
from rt_controller.safety.checks import CHECKS, Quantity
from rt_controller.safety.isolation import (
    Evidence,
    Faulty,
    cause_of,
    is_jump,
    isolate,
    isolate_path,
)

NOTHING = Evidence(0.0, 0.0, False, False, False, False, False, 0.0, 0.0, 0.0)
TURNED = NOTHING._replace(lateral_by_heading_m=0.2)
BY_QUANTITY = {check.quantity: check for check in CHECKS}
Q = Quantity


@pytest.mark.parametrize(
    ("quantity", "evidence", "faulty"),
    [
        (Q.PROGRESS_STEP_M, NOTHING._replace(speed_error_mps=2.0), Faulty.SPEED),
        (Q.PROGRESS_SPEED_MPS, NOTHING._replace(progress_error_mps=2.0), Faulty.PROGRESS),
        (Q.SPEED_STEP_MPS, NOTHING, Faulty.SPEED),
        (Q.LATERAL_SPEED_STEP_MPS, NOTHING, Faulty.LATERAL_SPEED),
        (Q.YAW_RATE_STEP_RADPS, NOTHING, Faulty.YAW_RATE),
        (Q.HEADING_RAD, NOTHING._replace(is_heading_jump=True), Faulty.HEADING),
        (Q.HEADING_RAD, NOTHING._replace(contradicts_yaw_rate=True), Faulty.YAW_RATE),
        (Q.HEADING_RAD, NOTHING._replace(curvature_error_per_m=0.01), Faulty.CURVATURE),
        (Q.HEADING_RAD, NOTHING._replace(lateral_by_heading_m=0.2), Faulty.HEADING),
        (Q.HEADING_RAD, NOTHING._replace(lateral_by_yaw_rate_m=0.2), Faulty.YAW_RATE),
        (Q.HEADING_RAD, NOTHING._replace(estimated=Faulty.LATERAL_ERROR), Faulty.HEADING),
        (Q.LATERAL_ERROR_M, NOTHING, Faulty.LATERAL_ERROR),
        (Q.LATERAL_ERROR_M, NOTHING._replace(contradicts_lateral_speed=True), Faulty.LATERAL_SPEED),
        (
            Q.LATERAL_ERROR_M,
            NOTHING._replace(contradicts_lateral_speed=True, is_lateral_jump=True),
            Faulty.LATERAL_ERROR,
        ),
        (Q.FROZEN_TICKS, NOTHING, Faulty.STATE),
        (Q.CURVATURE_STEP_PER_M, NOTHING, Faulty.CURVATURE),
        (Q.YAW_RATE_TEN_RADPS, NOTHING, Faulty.NONE),
        # at and above the limits
        (Q.PROGRESS_STEP_M, NOTHING, Faulty.PROGRESS),
        (Q.LATERAL_ERROR_M, NOTHING._replace(is_lateral_slow=True), Faulty.NONE),
        (Q.LATERAL_ERROR_M, TURNED._replace(lateral_by_yaw_rate_m=0.1), Faulty.HEADING),
        (Q.LATERAL_ERROR_M, TURNED._replace(lateral_by_yaw_rate_m=0.2), Faulty.LATERAL_ERROR),
        (Q.HEADING_RAD, TURNED, Faulty.HEADING),
        (Q.HEADING_RAD, TURNED._replace(contradicts_yaw_rate=True), Faulty.YAW_RATE),
        (Q.HEADING_RAD, TURNED._replace(curvature_error_per_m=1e-3), Faulty.HEADING),
        (Q.HEADING_RAD, TURNED._replace(curvature_error_per_m=1.1e-3), Faulty.CURVATURE),
        (Q.HEADING_RAD, TURNED._replace(lateral_by_yaw_rate_m=0.2), Faulty.YAW_RATE),
    ],
)
def test_the_other_residuals_decide_which_signal_is_faulty(
    quantity: Quantity, evidence: Evidence, faulty: int
) -> None:
    assert isolate(BY_QUANTITY[quantity], evidence) == faulty


def test_of_a_path_the_curvature_ahead_is_faulty_or_the_rest() -> None:
    assert isolate_path(BY_QUANTITY[Q.PREVIEW_STEP_PER_M]) == Faulty.PREVIEW
    assert isolate_path(BY_QUANTITY[Q.PATH_DRIFT_M]) == Faulty.PATH
    assert isolate_path(BY_QUANTITY[Q.PATH_SPEED_STEP_MPS]) == Faulty.NONE


def test_the_cause_names_the_faulty_signal() -> None:
    heading = BY_QUANTITY[Q.HEADING_RAD]
    assert cause_of(heading, Faulty.YAW_RATE) is StopCause.YAW_RATE_IMPLAUSIBLE
    assert cause_of(heading, Faulty.NONE) is StopCause.HEADING_IMPLAUSIBLE
    assert cause_of(BY_QUANTITY[Q.PATH_STEP_M], Faulty.PATH) is StopCause.PATH_JUMP
    ahead = BY_QUANTITY[Q.PREVIEW_STEP_PER_M]
    assert cause_of(ahead, Faulty.PREVIEW) is StopCause.PREVIEW_JUMP
    assert cause_of(BY_QUANTITY[Q.ENGAGE_EY_M], Faulty.NONE) is StopCause.NOT_ENGAGED


@pytest.mark.parametrize("flag", [True, False])
def test_a_jump_is_distinguished_from_a_drift(flag: bool) -> None:
    evidence = NOTHING._replace(is_heading_jump=flag, is_lateral_jump=not flag)
    assert is_jump(BY_QUANTITY[Q.HEADING_RAD], evidence) == flag
    assert is_jump(BY_QUANTITY[Q.LATERAL_ERROR_M], evidence) != flag


def test_each_signal_has_its_own_bit() -> None:
    names = {"PLACE", "LATERAL_MOTION", "MOTION", "STATE"}
    single = [each for each in Faulty if each.name not in names]
    assert sorted(single) == [0, *(2**k for k in range(9))]


def test_place_motion_and_state_are_the_signals_of_the_state() -> None:
    assert Faulty.PLACE == Faulty.HEADING | Faulty.LATERAL_ERROR
    assert Faulty.MOTION == Faulty.SPEED | Faulty.LATERAL_SPEED | Faulty.YAW_RATE
    assert Faulty.STATE == Faulty.PLACE | Faulty.MOTION | Faulty.PROGRESS
