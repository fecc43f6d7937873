"""Any frame at all is read without an exception, at both ends."""

from random import Random

import can
import pytest
from made_frames import CONTENTS, can_frames

from rt_controller.bus.messages import CATALOGUE, Node
from rt_controller.bus.receive import Inbox
from rt_controller.contract.timing import PERIOD_NS

CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]


def fuzzed_frame(rng: Random) -> can.Message:
    """Random bytes, random bytes with a good checksum, or a good frame with another counter."""
    kind = rng.random()
    if kind < 0.3:
        length = rng.choice([0, 1, 7, 8, 8, 8])
        return can.Message(
            arbitration_id=rng.choice([rng.randrange(0x800), rng.choice(CODECS).arbitration_id]),
            is_extended_id=rng.random() < 0.05,
            is_remote_frame=rng.random() < 0.02,
            is_error_frame=rng.random() < 0.02,
            data=rng.randbytes(length),
        )
    if kind < 0.7:
        codec = rng.choice(CODECS)
        values = [rng.choice([1e-3, 1.0, 1e3]) * rng.uniform(-1, 1) for _ in codec.signals]
        data = codec.encode(values, rng.randrange(16), rng.randrange(16))
        return can.Message(arbitration_id=codec.arbitration_id, is_extended_id=False, data=data)
    message = rng.choice(list(CONTENTS))
    return rng.choice(can_frames(message, CONTENTS[message], rng.randrange(128)))


def check_fuzzed_frames(number: int) -> None:
    rng = Random(11)
    inboxes = [Inbox(node) for node in Node]
    now_ns = 0
    for place in range(number):
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


def test_10_000_fuzzed_frames_raise_nothing() -> None:
    check_fuzzed_frames(10_000)


@pytest.mark.nightly
def test_1e6_fuzzed_frames_raise_nothing() -> None:
    check_fuzzed_frames(1_000_000)
