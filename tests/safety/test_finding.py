"""Checks that were above their threshold for their window, and what they mean together."""

import pytest

from rt_controller.contract.faults import StopCause
from rt_controller.safety.checks import CHECKS, Check, Quantity, Reaction
from rt_controller.safety.isolation import Evidence, Faulty, Windows, finding_of, finding_of_state

GROUP = range(2)
FIRST = Check("a", Quantity(0), 1.0, 1, Reaction.REJECT_STATE, StopCause.SPEED_IMPLAUSIBLE)
SECOND = Check("b", Quantity(1), 2.0, 3, Reaction.STOP, StopCause.TRACKING_LOST)
OF_OTHER_GROUP = FIRST._replace(quantity=Quantity(2))
HEADING, LATERAL_ERROR = Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M
BY_QUANTITY = {check.quantity: check for check in CHECKS}


def windows(values: list[float]) -> Windows:
    return Windows(values, (FIRST, SECOND, OF_OTHER_GROUP), (GROUP,))


def test_a_value_at_its_threshold_is_no_finding() -> None:
    values = [1.0, 2.0, 9.0]
    assert windows(values).failing(GROUP) == []
    values[0] = 1.01
    assert windows(values).failing(GROUP) == [FIRST]


def test_a_check_fails_from_the_last_tick_of_its_window_on() -> None:
    each = windows([0.0, 2.1, 9.0])
    assert [each.failing(GROUP) for _ in range(5)] == [[], [], [SECOND], [SECOND], [SECOND]]


def test_a_tick_below_the_threshold_restarts_the_window() -> None:
    values = [0.0, 2.1, 9.0]
    each = windows(values)
    found = []
    for value in (2.1, 2.1, 2.0, 2.1, 2.1, 2.1):
        values[1] = value
        found.append(len(each.failing(GROUP)))
    assert found == [0, 0, 0, 0, 0, 1]


def test_a_new_drive_restarts_the_window() -> None:
    each = windows([0.0, 2.1, 9.0])
    for _ in range(2):
        each.failing(GROUP)
    each.begin()
    assert [len(each.failing(GROUP)) for _ in range(3)] == [0, 0, 1]


def test_the_cause_is_that_of_the_first_check_that_names_a_signal() -> None:
    ten, heading = BY_QUANTITY[Quantity.YAW_RATE_TEN_RADPS], BY_QUANTITY[Quantity.HEADING_RAD]
    lateral = BY_QUANTITY[Quantity.LATERAL_ERROR_M]
    found = finding_of(
        [ten, heading, lateral],
        [Faulty.NONE, Faulty.HEADING, Faulty.LATERAL_ERROR],
    )
    assert found == (Faulty.PLACE, StopCause.HEADING_IMPLAUSIBLE, True)
    only = finding_of([heading], [Faulty.HEADING])
    assert only == (Faulty.HEADING, StopCause.HEADING_IMPLAUSIBLE, False)


def test_without_a_faulty_signal_the_cause_is_that_of_the_first_check() -> None:
    speed, yaw = BY_QUANTITY[Quantity.SPEED_TEN_MPS], BY_QUANTITY[Quantity.YAW_RATE_TEN_RADPS]
    found = finding_of([speed, yaw], [Faulty.NONE, Faulty.NONE])
    assert found == (Faulty.NONE, StopCause.SPEED_IMPLAUSIBLE, True)


@pytest.mark.parametrize(
    ("quantities", "is_heading_jump", "is_repeated", "expected"),
    [
        (
            [HEADING],
            True,
            False,
            (Faulty.HEADING, StopCause.HEADING_IMPLAUSIBLE, False),
        ),
        (
            [HEADING],
            False,
            False,
            (Faulty.YAW_RATE, StopCause.YAW_RATE_IMPLAUSIBLE, True),
        ),
        (
            [HEADING, LATERAL_ERROR],
            True,
            False,
            (Faulty.STATE, StopCause.HEADING_IMPLAUSIBLE, False),
        ),
        ([Quantity.SPEED_STEP_MPS], True, True, (Faulty.STATE, StopCause.STATE_OLD, True)),
    ],
    ids=["a jump is rejected", "a drift stops the car", "two signals", "an old state"],
)
def test_checks_of_the_state_name_the_faulty_signals(
    quantities: list[Quantity],
    is_heading_jump: bool,
    is_repeated: bool,
    expected: tuple[int, StopCause, bool],
) -> None:
    evidence = Evidence(0.0, 0.0, 0.0, 0.0, is_heading_jump, True, False, 0.0, 0.0, 0.0)
    failing = [BY_QUANTITY[quantity] for quantity in quantities]
    assert finding_of_state(failing, evidence, is_repeated) == expected
