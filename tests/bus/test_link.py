"""Sequence of counters and state machine, against AUTOSAR's rules written out independently."""

from collections import deque
from itertools import product
from random import Random

import pytest
from made_frames import can_frame

from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.messages import COMMAND, MISSION, Node
from rt_controller.bus.receive import MAX_DELTA_COUNTER, Inbox, Link, LinkState, ReceptionCounts

OK, OTHER, ERROR, NOTHING = "OK", "OTHER", "ERROR", "NONEWDATA"
CODECS = {16: COMMAND.codecs[0], 128: MISSION.codecs[0], 256: COMMAND.fd_codecs[0]}
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
    sender = COMMAND.sender if codec in COMMAND.codecs + COMMAND.fd_codecs else MISSION.sender
    receiver = Node.VEHICLE if sender is Node.CONTROLLER else Node.CONTROLLER
    inbox = Inbox(receiver, is_fd=codec.is_fd)
    values = tuple([1.0] * codec.n_values)
    for counter in counters:
        inbox.accept(can_frame(codec, codec.write(values, counter)), 0)
    return inbox.counts


@pytest.mark.parametrize("modulus", CODECS)
@pytest.mark.parametrize("last", [0, 1, 9, 15])
def test_every_next_counter_has_the_status_of_the_specification(modulus: int, last: int) -> None:
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
def test_of_two_senders_in_turn_every_second_frame_at_least_is_refused(modulus: int) -> None:
    for offset in range(2, modulus - 1):
        counters = [(i + side) % modulus for i in range(9) for side in (0, offset)]
        counts = counts_after(CODECS[modulus], *counters)
        assert counts.wrong_sequence + counts.repeated >= 8


def test_every_sequence_of_six_statuses_leads_to_the_states_of_the_oracle() -> None:
    for statuses in product((OK, OTHER, ERROR, NOTHING), repeat=6):
        link, oracle = Link(), Oracle()
        for status in (OK, OK, *statuses):
            assert add(link, status) == oracle.check(status)


@pytest.mark.parametrize("damage", [0.02, 0.2, 0.6])
def test_long_random_sequences_lead_to_the_states_of_the_oracle(damage: float) -> None:
    rng = Random(7)
    link, oracle = Link(), Oracle()
    seen = set()
    for _ in range(20_000):
        status = rng.choice((OK, OTHER, ERROR, NOTHING)) if rng.random() < damage else OK
        assert add(link, status) == oracle.check(status)
        seen.add(link.state)
    assert LinkState.VALID in seen
    assert (LinkState.INVALID in seen) is (damage > 0.1)
