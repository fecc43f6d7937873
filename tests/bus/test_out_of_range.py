"""What is wrong with frames that may not be used, in words."""

from math import nan

import can
from made_frames import SAMPLE, can_frames

from rt_controller.bus.catalogue import REFERENCE, STATE
from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node


def test_the_first_refused_frame_since_the_last_content_is_explained() -> None:
    def state(counter: int, **changed: float) -> list[can.Message]:
        content = SAMPLE._replace(state=SAMPLE.state._replace(**changed))
        return can_frames(STATE, content, counter)

    inbox = Inbox(Node.CONTROLLER)
    for frame in (*state(1, vy_mps=nan), *state(2)):
        inbox.accept(frame, 0)
    assert inbox.explain_out_of_range(REFERENCE) == ""
    assert inbox.explain_out_of_range(STATE).startswith("STATE_A: VelocityY: expected")
    for frame in (*state(3, ey_m=-40.0), *state(4, ey_m=-50.0, ds_m=nan)):
        inbox.accept(frame, 0)
    assert inbox.explain_out_of_range(STATE) == (
        "STATE_B: LateralError: expected a value of -30 to 30 m, found none or one beyond it"
    )


def test_a_raw_value_beyond_the_declared_range_is_named() -> None:
    lateral_error = STATE.codecs[1].signals[1]
    expected = "LateralError: expected a value of -30 to 30 m, found 31.2"
    assert lateral_error.objection(30_000) is None
    assert lateral_error.objection(31_200) == expected
