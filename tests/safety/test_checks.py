"""The table of checks is complete, and the one that is documented."""

import re
from math import inf
from pathlib import Path

import pytest

from rt_controller.contract.faults import Fault, StopCause
from rt_controller.safety.checks import CHECKS, LARGEST_CURVATURE_STEP_PER_M, Quantity, Reaction

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
    "path step, path drift": (Q.PATH_STEP_M, Q.PATH_DRIFT_M),
    "path frozen": (Q.PATH_FROZEN_M,),
    "path turn": (Q.PATH_TURN_RAD,),
    "wanted speed": (Q.PATH_SPEED_STEP_MPS,),
    "speed by pedals": (Q.PEDAL_SPEED_MPS,),
    "path acceleration": (Q.PATH_LATERAL_MPS2,),
    "engagement": (Q.ENGAGE_EY_M, Q.ENGAGE_EPSI_RAD),
}
"""rows of the page with thresholds; where one is for all quantities it is written once"""


def documented() -> dict[Quantity, tuple[float, int]]:
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
def test_thresholds_and_windows_are_the_documented_ones() -> None:
    expected = documented()
    found = {each.quantity: (each.threshold, each.window_ticks) for each in CHECKS}
    del found[Quantity.FROZEN_TICKS]  # counts ticks itself
    assert found == expected
    assert expected[Quantity.PREVIEW_STEP_PER_M][0] == LARGEST_CURVATURE_STEP_PER_M


def test_the_quantities_count_up_from_zero() -> None:
    assert list(Quantity) == list(range(len(Quantity)))


def test_every_check_has_a_threshold_and_a_window() -> None:
    assert {check.quantity for check in CHECKS} == set(Quantity)
    for check in CHECKS:
        assert 0.0 < check.threshold < inf
        assert check.window_ticks >= 1
        assert (check.reaction is Reaction.REFUSE) == (check.cause is StopCause.NOT_ENGAGED)
        assert check.window_ticks * 0.025 <= 0.5


@pytest.mark.skipif(not PAGE.exists(), reason="not in a checkout")
def test_every_heartbeat_bit_and_every_cause_of_a_stop_has_a_fault_in_the_table() -> None:
    section = PAGE.read_text(encoding="utf-8").split("## Faults\n")[1].split("\n## ")[0]
    rows = [line.split(" | ") for line in section.splitlines() if line.startswith("| ")]
    names = [row[1].partition(" · ") for row in rows if len(row) == 5]
    bits = {bit for before, _, _ in names for bit in re.findall(r"[A-Z]+_[A-Z_]+", before)}
    causes = {cause for _, _, after in names for cause in re.findall(r"[A-Z]+_[A-Z_]+", after)}
    assert bits >= {bit.name for bit in Fault}
    assert causes >= {cause.name for cause in StopCause} - {"NONE"}
    known = {bit.name for bit in Fault} | {cause.name for cause in StopCause}
    assert bits | causes <= known
