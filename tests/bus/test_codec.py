"""The fast codec is bit-equal to cantools, in both directions, for every frame."""

from math import inf, isnan, nan

import cantools
import pytest
from cantools.autosar.end_to_end import apply_profile2_crc
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.bus.codec import COUNTER_MASK, FrameCodec
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
@settings(derandomize=True, deadline=None)
@given(data=st.data())
def test_values_in_range_encode_to_the_bits_of_cantools(
    codec: FrameCodec, data: st.DataObject
) -> None:
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
@settings(derandomize=True, deadline=None)
@given(data=st.data())
def test_raw_values_in_range_decode_to_the_floats_of_cantools(
    codec: FrameCodec, data: st.DataObject
) -> None:
    oracle = _oracle(codec)
    raws = {
        layout.name: data.draw(st.integers(layout.raw_min, layout.raw_max), label=layout.name)
        for layout in codec.signals
    }
    frame = oracle.encode(
        {"Crc": 0, "Counter": 0, **_nibble(codec, 1), **raws}, scaling=False, strict=False
    )
    decoded = oracle.decode(frame, decode_choices=False)
    assert codec.decode(frame) == tuple(decoded[layout.name] for layout in codec.signals)


@every_frame
@settings(derandomize=True, deadline=None)
@given(data=st.data())
def test_any_eight_bytes_decode_to_values_in_range_or_to_nan(
    codec: FrameCodec, data: st.DataObject
) -> None:
    oracle = _oracle(codec)
    frame = data.draw(st.binary(min_size=8, max_size=8))
    raws = oracle.decode(frame, decode_choices=False, scaling=False)
    for layout, value in zip(codec.signals, codec.decode(frame), strict=True):
        is_in_range = layout.raw_min <= raws[layout.name] <= layout.raw_max
        assert isnan(value) != is_in_range


@every_frame
@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e300, -1e300])
def test_a_value_that_cannot_be_sent_becomes_not_available(codec: FrameCodec, bad: float) -> None:
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
def test_a_range_ends_half_an_lsb_outside_its_bounds(codec: FrameCodec) -> None:
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
def test_a_counter_is_read_with_its_cycle_as_it_was_written(codec: FrameCodec) -> None:
    values = (1,) * codec.n_values
    assert codec.counter_modulus == (16 if codec.name in ("ACT_CMD", "CTRL_HB") else 128)
    for counter in range(128):
        frame = codec.write(values, counter)
        assert codec.check(frame) >= 0
        assert codec.check(frame) == counter % codec.counter_modulus
        assert frame[1] & COUNTER_MASK == counter % 16


@pytest.mark.parametrize("length", [0, 1, 7, 9, 64])
def test_a_frame_of_another_length_is_not_intact(length: int) -> None:
    assert not (COMMAND.codecs[0].check(bytes(length)) >= 0)


def test_a_command_has_the_bytes_computed_by_hand() -> None:
    """0.5 / 2e-5 = 25000 = 0x61A8; 30 N / 0.0025 = 12000 = 0x2EE0; -10 deg / 0.02 = -500."""
    frame = COMMAND.codecs[0].encode((0.5, 30.0, -10.0), 9, 2)
    assert frame[1:] == bytes.fromhex("29 A861 E02E 0CFE")
