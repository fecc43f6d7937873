"""What the message of a safe stop says about its cause."""

from typing import Any

import pytest
from made_frames import PATH, SAMPLE, can_frames

from rt_controller.bus.catalogue import REFERENCE, STATE
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Message, Node
from rt_controller.safety.modes import StopCause
from rt_controller.terminal.run import explain_stop


def test_a_safe_stop_without_a_state_says_what_to_check() -> None:
    text = explain_stop(StopCause.STATE_LOST, Inbox(Node.CONTROLLER), ())
    assert text.startswith("no new vehicle state arrived in time. Check that the vehicle")


@pytest.mark.parametrize(
    ("cause", "message", "content", "expected"),
    [
        (
            StopCause.STATE_INVALID,
            *(STATE, SAMPLE._replace(state=SAMPLE.state._replace(ey_m=30.1))),
            "STATE_B: LateralError: expected a value of -30 to 30 m, found none or one beyond it",
        ),
        (
            StopCause.REFERENCE_INVALID,
            *(REFERENCE, PATH._replace(c0_m=-31.0)),
            "REF_PATH: C0: expected a value of -30 to 30 m, found none or one beyond it",
        ),
    ],
)
def test_a_safe_stop_names_the_signal_that_is_out_of_range(
    cause: StopCause, message: Message[Any], content: Any, expected: str
) -> None:
    inbox = Inbox(Node.CONTROLLER)
    for frame in can_frames(message, content, 1):
        inbox.accept(frame, 0)
    assert explain_stop(cause, inbox, ()) == f"{cause.value}. {expected}."
