"""Frames with one counter make a content; what is wrong with frames that may not be used."""

from itertools import permutations
from math import nan

import can
import pytest
from made_frames import PATH, SAMPLE, can_frames, encode_frames

from rt_controller.bus.messages import REFERENCE, STATE, Node
from rt_controller.bus.receive import MAX_SPREAD_NS, Inbox
from rt_controller.contract.timing import COUNTER_MODULUS, PERIOD_NS


@pytest.mark.parametrize(
    ("message", "content", "order"),
    [(STATE, SAMPLE, order) for order in permutations(range(3))]
    + [(REFERENCE, PATH, order) for order in permutations(range(2))],
)
def test_frames_with_one_counter_make_a_content_in_any_order(message, content, order) -> None:
    inbox = Inbox(Node.CONTROLLER)
    frames = can_frames(message, content, 5)
    for position, index in enumerate(order):
        assert inbox.newest(message) is None
        inbox.accept(frames[index], 100 + position)
    newest = inbox.newest(message)
    assert newest is not None
    assert encode_frames(message, newest.content, 5) == encode_frames(message, content, 5)
    assert (newest.counter, newest.arrival_ns) == (5, 100)


@pytest.mark.parametrize(("message", "content"), [(STATE, SAMPLE), (REFERENCE, PATH)])
def test_frames_of_different_cycles_of_the_counter_make_no_content(message, content) -> None:
    """A four-bit counter repeats every 16 periods: later it is another sample."""
    inbox = Inbox(Node.CONTROLLER)
    first, *others = can_frames(message, content, 5)
    inbox.accept(first, 0)
    for frame in others:
        inbox.accept(frame, COUNTER_MODULUS * PERIOD_NS)
    assert inbox.newest(message) is None


def test_the_allowed_spread_is_within_one_cycle_of_the_counter() -> None:
    assert PERIOD_NS < MAX_SPREAD_NS < (COUNTER_MODULUS - 1) * PERIOD_NS
    inbox = Inbox(Node.CONTROLLER)
    for frame, arrival_ns in zip(can_frames(STATE, SAMPLE, 5), (0, 1, MAX_SPREAD_NS), strict=True):
        inbox.accept(frame, arrival_ns)
    assert inbox.newest(STATE) is not None


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
    assert lateral_error.objection(30_000) == ""
    assert lateral_error.objection(31_200) == expected
