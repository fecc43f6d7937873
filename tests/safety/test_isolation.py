"""The table of checks, windows, and which signal is faulty for which residuals."""

import re
from math import inf
from pathlib import Path

import pytest

from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.safety.checks import CHECKS, LARGEST_CURVATURE_STEP_PER_M, Check, Reaction
from rt_controller.safety.isolation import (
    Evidence,
    Faulty,
    Windows,
    cause_of,
    finding_of,
    finding_of_state,
    is_jump,
    isolate,
    isolate_path,
)

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "monitors.md"
Q = Quantity
ROWS = {
    "progress": (Q.PROGRESS_STEP_M,),
    "speed and progress": (Q.PROGRESS_SPEED_MPS,),
    "v_x, v_y, yaw rate, one step": (
        *(Q.SPEED_STEP_MPS, Q.LATERAL_SPEED_STEP_MPS, Q.YAW_RATE_STEP_RADPS),
    ),
    "v_x, v_y, yaw rate, ten steps": (
        *(Q.SPEED_TEN_MPS, Q.LATERAL_SPEED_TEN_MPS, Q.YAW_RATE_TEN_RADPS),
    ),
    "heading": (Q.HEADING_RAD,),
    "lateral error": (Q.LATERAL_ERROR_M,),
    "curvature step, curvature ahead": (Q.CURVATURE_STEP_PER_M, Q.PREVIEW_STEP_PER_M),
    "feedback of steering, throttle, brake": (Q.STEERING_RAD, Q.THROTTLE, Q.BRAKE_N),
    "tracking": (Q.TRACKING_M,),
    "speed": (Q.SPEED_MPS,),
    "training": (Q.OUTSIDE_TRAINING,),
    "path step, path drift": (Q.PATH_STEP_M, Q.PATH_DRIFT_M),
    "path frozen": (Q.PATH_FROZEN_M,),
    "path turn": (Q.PATH_TURN_RAD,),
    "wanted speed": (Q.PATH_SPEED_STEP_MPS,),
    "speed by pedals": (Q.PEDAL_SPEED_MPS,),
    "path acceleration": (Q.PATH_LATERAL_MPS2,),
    "engagement": (Q.ENGAGE_EY_M, Q.ENGAGE_EPSI_RAD),
}
"""rows of the page with thresholds; where one is for all quantities it is written once"""


def documented():
    """Threshold and window in ticks, by the page."""
    page = PAGE.read_text(encoding="utf-8")
    found = {}
    for label, quantities in ROWS.items():
        (row,) = re.findall(rf"^\| {label} \| [^|]+ \| ([^|]+) \| ([^|]+) \|$", page, re.MULTILINE)
        thresholds = [float(part.split()[0]) for part in row[0].split(",")]
        if len(thresholds) == 1:
            thresholds *= len(quantities)
        length, unit = row[1].split()
        ticks = round(float(length) / 25.0) if unit == "ms" else int(length)
        for quantity, threshold in zip(quantities, thresholds, strict=True):
            found[quantity] = (threshold, ticks)
    return found


@pytest.mark.skipif(not PAGE.exists(), reason="not in a checkout")
def test_thresholds_and_windows_are_the_documented_ones():
    expected = documented()
    found = {each.quantity: (each.threshold, each.window_ticks) for each in CHECKS}
    del found[Quantity.FROZEN_TICKS]  # counts ticks itself
    assert found == expected
    assert expected[Quantity.PREVIEW_STEP_PER_M][0] == LARGEST_CURVATURE_STEP_PER_M


def test_every_check_has_a_threshold_and_a_window():
    assert list(Quantity) == list(range(len(Quantity)))
    assert {check.quantity for check in CHECKS} == set(Quantity)
    for check in CHECKS:
        assert 0.0 < check.threshold < inf
        assert check.window_ticks >= 1
        assert (check.reaction is Reaction.REFUSE) == (check.cause is StopCause.NOT_ENGAGED)
        assert check.window_ticks * 0.025 <= 0.5 or check.reaction is Reaction.REPORT


@pytest.mark.skipif(not PAGE.exists(), reason="not in a checkout")
def test_every_heartbeat_bit_and_every_cause_of_a_stop_has_a_fault_in_the_table():
    section = PAGE.read_text(encoding="utf-8").split("## Faults\n")[1].split("\n## ")[0]
    rows = [line.split(" | ") for line in section.splitlines() if line.startswith("| ")]
    names = [row[1].partition(" · ") for row in rows if len(row) == 5]
    bits = {bit for before, _, _ in names for bit in re.findall(r"[A-Z]+_[A-Z_]+", before)}
    causes = {cause for _, _, after in names for cause in re.findall(r"[A-Z]+_[A-Z_]+", after)}
    assert bits >= {bit.name for bit in Fault}
    assert causes >= {cause.name for cause in StopCause} - {"NONE"}
    known = {bit.name for bit in Fault} | {cause.name for cause in StopCause}
    assert bits | causes <= known


NOTHING = Evidence(0.0, 0.0, False, False, False, False, False, 0.0, 0.0, 0.0)
TURNED = NOTHING._replace(lateral_by_heading_m=0.2)
BY_QUANTITY = {check.quantity: check for check in CHECKS}


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
def test_the_other_residuals_decide_which_signal_is_faulty(quantity, evidence, faulty):
    assert isolate(BY_QUANTITY[quantity], evidence) == faulty


@pytest.mark.parametrize(
    ("quantity", "faulty", "cause"),
    [
        (Q.HEADING_RAD, Faulty.YAW_RATE, StopCause.YAW_RATE_IMPLAUSIBLE),
        (Q.HEADING_RAD, Faulty.NONE, StopCause.HEADING_IMPLAUSIBLE),
        (Q.ENGAGE_EY_M, Faulty.NONE, StopCause.NOT_ENGAGED),
    ],
)
def test_the_cause_names_the_faulty_signal(quantity, faulty, cause):
    assert cause_of(BY_QUANTITY[quantity], faulty) is cause


@pytest.mark.parametrize(
    ("quantity", "faulty", "cause"),
    [
        (Q.PREVIEW_STEP_PER_M, Faulty.PREVIEW, StopCause.PREVIEW_JUMP),
        (Q.PATH_STEP_M, Faulty.PATH, StopCause.PATH_JUMP),
        (Q.PATH_DRIFT_M, Faulty.PATH, StopCause.PATH_INCONSISTENT),
        (Q.PATH_SPEED_STEP_MPS, Faulty.NONE, StopCause.PATH_SPEED_JUMP),
    ],
)
def test_of_a_path_the_curvature_ahead_is_faulty_or_the_rest(quantity, faulty, cause):
    assert isolate_path(BY_QUANTITY[quantity]) == faulty
    assert cause_of(BY_QUANTITY[quantity], faulty) is cause


@pytest.mark.parametrize("flag", [True, False])
def test_a_jump_is_distinguished_from_a_drift(flag):
    evidence = NOTHING._replace(is_heading_jump=flag, is_lateral_jump=not flag)
    assert is_jump(BY_QUANTITY[Q.HEADING_RAD], evidence) == flag
    assert is_jump(BY_QUANTITY[Q.LATERAL_ERROR_M], evidence) != flag


def test_each_signal_has_its_own_bit_and_the_state_is_all_of_its_signals():
    names = {"PLACE", "LATERAL_MOTION", "MOTION", "STATE"}
    single = [each for each in Faulty if each.name not in names]
    assert sorted(single) == [0, *(2**k for k in range(9))]
    assert Faulty.PLACE == Faulty.HEADING | Faulty.LATERAL_ERROR
    assert Faulty.MOTION == Faulty.SPEED | Faulty.LATERAL_SPEED | Faulty.YAW_RATE
    assert Faulty.STATE == Faulty.PLACE | Faulty.MOTION | Faulty.PROGRESS


GROUP = range(2)
FIRST = Check("a", Quantity(0), 1.0, 1, Reaction.REJECT_STATE, StopCause.SPEED_IMPLAUSIBLE)
SECOND = Check("b", Quantity(1), 2.0, 3, Reaction.STOP, StopCause.TRACKING_LOST)
OF_OTHER_GROUP = FIRST._replace(quantity=Quantity(2))
HEADING, LATERAL_ERROR = Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M


def windows(values):
    return Windows(values, (FIRST, SECOND, OF_OTHER_GROUP), (GROUP,))


def failing(first, second, begins_at=None):
    """Names of the checks that fail, tick by tick, with these values of both."""
    values = [0.0, 0.0, 9.0]
    each, found = windows(values), []
    for tick, values[:2] in enumerate(zip(first, second, strict=True)):
        if tick == begins_at:
            each.begin()
        found.append("".join(check.name for check in each.failing(GROUP)))
    return found


@pytest.mark.parametrize(
    ("second", "begins_at", "expected"),
    [
        ([2.1] * 5, None, ["", "", "b", "b", "b"]),
        ([2.0] * 5, None, [""] * 5),  # at the threshold
        ([2.1, 2.1, 2.0, 2.1, 2.1, 2.1], None, ["", "", "", "", "", "b"]),
        ([2.1] * 5, 2, ["", "", "", "", "b"]),  # a new drive
    ],
)
def test_a_check_fails_from_the_last_tick_of_its_window_on(second, begins_at, expected):
    assert failing([0.0] * len(second), second, begins_at) == expected
    assert failing([1.0, 1.01, 1.0], [0.0] * 3) == ["", "a", ""]


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        (
            [
                (Q.YAW_RATE_TEN_RADPS, Faulty.NONE),
                (Q.HEADING_RAD, Faulty.HEADING),
                (Q.LATERAL_ERROR_M, Faulty.LATERAL_ERROR),
            ],
            (Faulty.PLACE, StopCause.HEADING_IMPLAUSIBLE, True),
        ),
        ([(Q.HEADING_RAD, Faulty.HEADING)], (Faulty.HEADING, StopCause.HEADING_IMPLAUSIBLE, False)),
        (
            [(Q.SPEED_TEN_MPS, Faulty.NONE), (Q.YAW_RATE_TEN_RADPS, Faulty.NONE)],
            (Faulty.NONE, StopCause.SPEED_IMPLAUSIBLE, True),
        ),
    ],
)
def test_the_cause_is_that_of_the_first_check_that_names_a_signal_or_of_the_first(
    findings, expected
):
    quantities, faulty = zip(*findings, strict=True)
    assert finding_of([BY_QUANTITY[each] for each in quantities], list(faulty)) == expected


@pytest.mark.parametrize(
    ("quantities", "is_heading_jump", "is_repeated", "expected"),
    [
        ([HEADING], True, False, (Faulty.HEADING, StopCause.HEADING_IMPLAUSIBLE, False)),
        ([HEADING], False, False, (Faulty.YAW_RATE, StopCause.YAW_RATE_IMPLAUSIBLE, True)),
        (
            *([HEADING, LATERAL_ERROR], True, False),
            (Faulty.STATE, StopCause.HEADING_IMPLAUSIBLE, False),
        ),
        ([Q.SPEED_STEP_MPS], True, True, (Faulty.STATE, StopCause.STATE_OLD, True)),
    ],
    ids=["a jump is rejected", "a drift stops the car", "two signals", "an old state"],
)
def test_checks_of_the_state_name_the_faulty_signals(
    quantities, is_heading_jump, is_repeated, expected
):
    evidence = Evidence(0.0, 0.0, 0.0, 0.0, is_heading_jump, True, False, 0.0, 0.0, 0.0)
    failing = [BY_QUANTITY[quantity] for quantity in quantities]
    assert finding_of_state(failing, evidence, is_repeated) == expected
