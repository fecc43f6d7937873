"""The fast codec is bit-equal to cantools; its checksums detect errors of bits."""

from itertools import combinations
from math import inf, isnan, nan

import cantools
import pytest
from cantools.autosar.end_to_end import apply_profile2_crc, compute_profile2_crc
from crccheck.crc import Crc8Autosar
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.bus.codec import COUNTER_MASK, FrameCodec, crc8
from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import CATALOGUE, COMMAND

DATABASE = cantools.database.load_file(DBC_PATH, strict=True)
CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]
every_frame = pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)


def _oracle(codec: FrameCodec) -> cantools.database.can.Message:
    return DATABASE.get_message_by_name(codec.name)


def _nibble(codec: FrameCodec, nibble: int) -> dict[str, int]:
    """The signals in the high nibble of byte 1, by name."""
    names = {signal.name for signal in _oracle(codec).signals if 12 <= signal.start < 16}
    return {"Valid": nibble & 1, "Cycle": nibble >> 1} if "Valid" in names else {"Mode": nibble}


@every_frame
@given(data=st.data())
def test_values_in_range_encode_to_the_bits_of_cantools(codec, data):
    oracle = _oracle(codec)
    counter = data.draw(st.integers(0, 15))
    nibble = data.draw(st.integers(0, 5))
    values = [
        data.draw(st.floats(float(signal.minimum), float(signal.maximum)), label=layout.name)
        for layout in codec.signals
        for signal in [oracle.get_signal_by_name(layout.name)]
    ]
    by_name = dict(zip((layout.name for layout in codec.signals), values, strict=True))
    plain = oracle.encode({"Crc": 0, "Counter": counter, **_nibble(codec, nibble), **by_name})
    expected = apply_profile2_crc(plain, codec.data_ids[counter])

    frame = codec.encode(values, counter, nibble)

    assert frame == expected
    assert codec.check(frame) >= 0
    assert frame[1] & COUNTER_MASK == counter
    assert frame[1] >> 4 == nibble


@every_frame
@given(frame=st.binary(min_size=8, max_size=8))
def test_any_eight_bytes_decode_to_the_floats_of_cantools_or_outside_the_range_to_nan(codec, frame):
    raws = _oracle(codec).decode(frame, decode_choices=False, scaling=False)
    expected = _oracle(codec).decode(frame, decode_choices=False)
    for layout, value in zip(codec.signals, codec.decode(frame), strict=True):
        if layout.raw_min <= raws[layout.name] <= layout.raw_max:
            assert value == expected[layout.name]
        else:
            assert isnan(value)


@every_frame
@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e300, -1e300])
def test_a_value_that_cannot_be_sent_becomes_not_available(codec, bad):
    """It is not clipped: a clipped value would look like a measurement."""
    lowest = [layout.raw_min * layout.scale + layout.offset for layout in codec.signals]
    for place, layout in enumerate(codec.signals):
        values = lowest.copy()
        values[place] = bad
        frame = codec.encode(values, 3, 1)
        decoded = _oracle(codec).decode(frame)
        assert str(decoded[layout.name]) == "NotAvailable"
        assert codec.check(frame) >= 0
        assert isnan(codec.decode(frame)[place])
        assert codec.decode(frame)[:place] == tuple(lowest[:place])


@every_frame
def test_a_range_ends_half_an_lsb_outside_its_bounds(codec):
    """Rounding noise at a bound is no violation, the next raw value is one."""
    for place, layout in enumerate(codec.signals):
        for raw, outwards in ((layout.raw_min, -1), (layout.raw_max, 1)):
            values = [0.0] * len(codec.signals)
            values[place] = (raw + 0.4 * outwards) * layout.scale + layout.offset
            at_bound = raw * layout.scale + layout.offset
            assert codec.decode(codec.encode(values, 0, 1))[place] == at_bound
            values[place] = (raw + 0.6 * outwards) * layout.scale + layout.offset
            assert isnan(codec.decode(codec.encode(values, 0, 1))[place])


@every_frame
def test_a_counter_is_read_with_its_cycle_as_it_was_written(codec):
    values = (1,) * codec.n_values
    assert codec.counter_modulus == (16 if codec.name in ("ACT_CMD", "CTRL_HB") else 128)
    for counter in range(128):
        frame = codec.write(values, counter)
        assert codec.check(frame) >= 0
        assert codec.check(frame) == counter % codec.counter_modulus
        assert frame[1] & COUNTER_MASK == counter % 16


def test_a_command_has_the_bytes_computed_by_hand():
    """0.5 / 2e-5 = 25000 = 0x61A8; 30 N / 0.0025 = 12000 = 0x2EE0; -10 deg / 0.02 = -500."""
    frame = COMMAND.codecs[0].encode((0.5, 30.0, -10.0), 9, 2)
    assert frame[1:] == bytes.fromhex("29 A861 E02E 0CFE")


REMEDY = "new data ids: python tools/data_ids.py"


def is_intact(codec: FrameCodec, frame: bytes, flipped: tuple[int, ...] = ()) -> bool:
    """Whether a frame passes the checks of its protection after these bits were flipped."""
    word = int.from_bytes(frame, "little")
    for bit in flipped:
        word ^= 1 << bit
    return codec.check(word.to_bytes(len(frame), "little")) >= 0


@given(st.binary(min_size=8, max_size=8), st.integers(0, 0xFF))
def test_the_checksum_is_that_of_crccheck_and_of_cantools(frame, data_id):
    expected = Crc8Autosar.calc(frame[1:] + bytes([data_id]))
    assert crc8(frame, data_id) == compute_profile2_crc(frame, data_id) == expected


@every_frame
def test_every_error_of_one_or_two_bits_is_detected(codec):
    """Also in the counter, where an error also selects another data id."""
    pairs = [bits for n in (1, 2) for bits in combinations(range(64), n)]
    frame = codec.encode([1.0] * len(codec.signals), 5, 1)
    assert is_intact(codec, frame)
    assert not any(is_intact(codec, frame, bits) for bits in pairs), REMEDY
    of_counter = [bits for bits in pairs if set(bits) & {8, 9, 10, 11}]
    for counter in range(16):
        frame = codec.encode([1.0] * len(codec.signals), counter, 1)
        assert not any(is_intact(codec, frame, bits) for bits in of_counter), (counter, REMEDY)


def test_every_error_of_three_bits_of_a_command_outside_the_counter_is_detected():
    (codec,) = COMMAND.codecs
    frame = codec.encode((0.25, 10.0, -3.0), 5, 1)
    places = [bit for bit in range(64) if not 8 <= bit < 12]
    assert not any(is_intact(codec, frame, bits) for bits in combinations(places, 3))


@every_frame
def test_a_frame_of_another_message_or_length_or_of_equal_bytes_is_not_intact(codec):
    """Equal bytes: as a line without signal or an erased memory would give."""
    for counter in range(16):
        frame = codec.encode([1.0] * len(codec.signals), counter, 1)
        others = [other for other in CODECS if other is not codec]
        assert not any(is_intact(other, frame) for other in others), (counter, REMEDY)
        for length in (0, 1, 7, 9):
            assert not is_intact(codec, (frame + b"\0")[:length])
    assert not any(is_intact(codec, byte * 8) for byte in (b"\x00", b"\xff"))
