"""Counters against AUTOSAR's rules written out independently; what counts only twice."""

from collections import deque
from itertools import product
from random import Random

import can
import pytest
from made_frames import CONTENTS, CONTROL, ENGAGED, can_frame, can_frames

from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.identity import (
    DISENGAGED_FRAMES,
    Engagement,
    is_heartbeat_of,
)
from rt_controller.bus.messages import (
    CATALOGUE,
    COMMAND,
    MISSION,
    Command,
    Heartbeat,
    Mission,
    Node,
)
from rt_controller.bus.receive import (
    MAX_DELTA_COUNTER,
    Inbox,
    Link,
    LinkState,
    Received,
    ReceptionCounts,
)
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS

OK, OTHER, ERROR, NOTHING = "OK", "OTHER", "ERROR", "NONEWDATA"
CODECS = {16: COMMAND.codecs[0], 128: MISSION.codecs[0]}
"""by the number of their counters"""


class Oracle:
    """The state machine as PRS E2EProtocol words it: counts over a window, then transitions."""

    def __init__(self) -> None:
        self.state = "NODATA"
        self.window: deque[str] = deque([NOTHING] * 8, 8)

    def check(self, status: str) -> str:
        if self.state == "NODATA":
            if status not in (ERROR, NOTHING):
                self.state = "INIT"
            return self.state
        self.window.append(status)
        size, least, most = {"INIT": (4, 1, 1), "VALID": (8, 1, 3), "INVALID": (4, 3, 0)}[
            self.state
        ]
        recent = list(self.window)[len(self.window) - size :]
        errors, good = recent.count(ERROR), recent.count(OK)
        may_be_valid = errors <= most and good >= least
        if self.state == "INIT":
            self.state = "VALID" if may_be_valid else "INVALID" if errors > most else "INIT"
        else:
            self.state = "VALID" if may_be_valid else "INVALID"
        return self.state


NAMES = {
    LinkState.NO_DATA: "NODATA",
    LinkState.INIT: "INIT",
    LinkState.VALID: "VALID",
    LinkState.INVALID: "INVALID",
}


def add(link: Link, status: str) -> str:
    link.add(status == OK, is_damaged=status == ERROR, is_missing=status == NOTHING)
    return NAMES[link.state]


def counts_after(codec: FrameCodec, *counters: int) -> ReceptionCounts:
    inbox = Inbox(Node.VEHICLE if codec in COMMAND.codecs else Node.CONTROLLER)
    values = tuple([1.0] * codec.n_values)
    for counter in counters:
        inbox.accept(can_frame(codec, codec.write(values, counter)), 0)
    return inbox.counts


@pytest.mark.parametrize("modulus", CODECS)
@pytest.mark.parametrize("last", [0, 9, 15])
def test_every_next_counter_has_the_status_of_the_specification(modulus, last):
    codec, counter = CODECS[modulus], last
    for steps_ahead in range(modulus):  # by counting, not by subtraction
        expected = (
            ReceptionCounts(repeated=1) if steps_ahead == 0
            else ReceptionCounts(counter_gap_frames=steps_ahead - 1)
            if steps_ahead <= MAX_DELTA_COUNTER
            else ReceptionCounts(wrong_sequence=1)
        )  # fmt: skip
        assert counts_after(codec, last, counter) == expected
        counter = 0 if counter == modulus - 1 else counter + 1


@pytest.mark.parametrize("modulus", CODECS)
def test_of_two_senders_in_turn_every_second_frame_at_least_is_refused(modulus):
    for offset in range(2, modulus - 1, 1 + modulus // 50):
        counters = [(i + side) % modulus for i in range(9) for side in (0, offset)]
        counts = counts_after(CODECS[modulus], *counters)
        assert counts.wrong_sequence + counts.repeated >= 8


def test_every_sequence_of_six_statuses_leads_to_the_states_of_the_oracle():
    for statuses in product((OK, OTHER, ERROR, NOTHING), repeat=6):
        link, oracle = Link(), Oracle()
        for status in (OK, OK, *statuses):
            assert add(link, status) == oracle.check(status)


@pytest.mark.parametrize("damage", [0.02, 0.2, 0.6])
def test_long_random_sequences_lead_to_the_states_of_the_oracle(damage):
    rng = Random(7)
    link, oracle = Link(), Oracle()
    seen = set()
    for _ in range(5_000):
        status = rng.choice((OK, OTHER, ERROR, NOTHING)) if rng.random() < damage else OK
        assert add(link, status) == oracle.check(status)
        seen.add(link.state)
    assert LinkState.VALID in seen
    assert (LinkState.INVALID in seen) is (damage > 0.1)


OVER = ENGAGED._replace(is_engaged=False)


def confirmed(script: str) -> list[bool]:
    """For each received mission, E engaged and . over: whether the controller is to drive."""
    engagement = Engagement()
    answers = []
    for place, letter in enumerate(script):
        content: Mission = ENGAGED if letter == "E" else OVER
        received = Received(content, place, place)
        for _ in range(4):  # the same one in each period
            answer = engagement.confirmed(received)
        answers.append(answer)
    return answers


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("EEEE", "EEEE"),
        ("....", "...."),  # never engaged
        ("EE.EE", "EEEEE"),
        ("EE..E..E", "EEEEEEEE"),
        ("E...E", "EEE.E"),
        (".E", ".E"),
    ],
)
def test_a_mission_ends_after_several_frames_in_a_row(script, expected):
    assert confirmed(script) == [letter == "E" for letter in expected]
    assert DISENGAGED_FRAMES == 3


@pytest.mark.parametrize(
    ("counter", "state_counter", "mode", "expected"),
    [
        (5, 5, Mode.NOMINAL, True),
        (5, 21, Mode.NOMINAL, True),
        (5, 117, Mode.NOMINAL, True),
        (4, 5, Mode.NOMINAL, False),
        (6, 5, Mode.NOMINAL, False),
        (5, 4, Mode.NOMINAL, False),
        (5, 6, Mode.NOMINAL, False),
        (5, 5, Mode.SAFE_STOP, False),
    ],
)
def test_a_heartbeat_belongs_to_the_command_of_its_counter_state_and_mode(
    counter, state_counter, mode, expected
):
    heartbeat = Heartbeat(mode, Fault(0), state_counter, 0, 0, 1)
    found = is_heartbeat_of(
        Received(heartbeat, counter, 0), Received(Command(CONTROL, Mode.NOMINAL), 5, 0)
    )
    assert found is expected


ALL_CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]


def fuzzed_frame(rng: Random) -> can.Message:
    """Random bytes, random bytes with a good checksum, or a good frame with another counter."""
    kind = rng.random()
    if kind < 0.3:
        length = rng.choice([0, 1, 7, 8, 8, 8])
        return can.Message(
            arbitration_id=rng.choice(
                [rng.randrange(0x800), rng.choice(ALL_CODECS).arbitration_id]
            ),
            is_extended_id=rng.random() < 0.05,
            is_remote_frame=rng.random() < 0.02,
            is_error_frame=rng.random() < 0.02,
            data=rng.randbytes(length),
        )
    if kind < 0.7:
        codec = rng.choice(ALL_CODECS)
        values = [rng.choice([1e-3, 1.0, 1e3]) * rng.uniform(-1, 1) for _ in codec.signals]
        data = codec.encode(values, rng.randrange(16), rng.randrange(16))
        return can.Message(arbitration_id=codec.arbitration_id, is_extended_id=False, data=data)
    message = rng.choice(list(CONTENTS))
    return rng.choice(can_frames(message, CONTENTS[message], rng.randrange(128)))


def test_fuzzed_frames_raise_nothing():
    """Any frame at all is read without an exception, at both ends."""
    rng = Random(11)
    inboxes = [Inbox(node) for node in Node]
    now_ns = 0
    for place in range(6_000):
        frame = fuzzed_frame(rng)
        for inbox in inboxes:
            inbox.accept(frame, now_ns)
        if place % 12 == 0:
            for inbox in inboxes:
                for message in CATALOGUE.messages:
                    if message in inbox._assemblies:
                        inbox.newest_valid(message, now_ns)
                        inbox.has_conflict(message, now_ns)
                        inbox.explain_out_of_range(message)
                inbox.end_period(now_ns)
            now_ns += PERIOD_NS
    assert all(inbox.counts.crc_errors > 0 for inbox in inboxes)
    assert all(inbox.counts.wrong_sequence > 0 for inbox in inboxes)
