"""Bits on the wire, against an independent transmitter that sends bit by bit."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.bus.bus_load import bus_load, fd_frame_bits, frame_bits
from rt_controller.contract.timing import PERIOD_S


def transmitted(identifier: int, data: bytes) -> str:
    """The bits of a frame as a transmitter sends them, from the start of frame to the space."""
    word = f"0{identifier:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    register = [0] * 15
    for bit in word:
        feedback = int(bit) ^ register[0]
        register = [*register[1:], 0]
        if feedback:  # x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1
            for power in (14, 10, 8, 7, 4, 3, 0):
                register[14 - power] ^= 1
    sent = ""
    for bit in word + "".join(map(str, register)):
        sent += bit
        if len(sent) >= 5 and len(set(sent[-5:])) == 1 and run_length(sent) == 5:
            sent += "1" if bit == "0" else "0"
    return sent + "1" * 13


def run_length(sent: str) -> int:
    return len(sent) - len(sent.rstrip(sent[-1]))


@settings(derandomize=True, deadline=None, max_examples=400)
@given(
    st.integers(0, 0x7FF),
    st.lists(st.sampled_from([0x00, 0xFF, 0xF8, 0x1F, 0x55]), max_size=8).map(bytes)
    | st.binary(max_size=8),
)
def test_a_frame_has_the_bits_that_a_transmitter_sends(identifier: int, data: bytes) -> None:
    assert frame_bits(identifier, data) == len(transmitted(identifier, data))


def transmitted_fd(identifier: int, data: bytes) -> str:
    """The same of CAN FD without a switch of the bit rate; what the CRC is does not matter."""
    code = {12: 9, 16: 10, 20: 11, 24: 12, 32: 13, 48: 14, 64: 15}.get(len(data), len(data))
    word = f"0{identifier:011b}00" + "1" + "00" + "0" + f"{code:04b}"
    word += "".join(f"{byte:08b}" for byte in data)
    sent = ""
    for place, bit in enumerate(word):
        sent += bit
        is_last = place == len(word) - 1
        if not is_last and len(sent) >= 5 and run_length(sent) == 5:
            sent += "1" if bit == "0" else "0"
    crc = "c" * (17 if len(data) <= 16 else 21)
    checked = "nnnp" + crc  # stuff count with its parity, CRC
    for place, bit in enumerate(checked):
        sent += ("f" if place % 4 == 0 else "") + bit
    return sent + "1" * 13


@settings(derandomize=True, deadline=None, max_examples=200)
@given(
    st.integers(0, 0x7FF),
    st.sampled_from([0, 8, 12, 16, 20, 24, 32, 48, 64]),
    st.sampled_from([0x00, 0xFF, 0xF8, 0x1F, 0x55]),
    st.binary(min_size=64, max_size=64),
)
def test_a_frame_of_can_fd_has_the_bits_that_a_transmitter_sends(
    identifier: int, length: int, byte: int, random: bytes
) -> None:
    for data in (bytes([byte] * length), random[:length]):
        assert fd_frame_bits(identifier, data) == len(transmitted_fd(identifier, data))


def test_eight_bytes_need_111_to_135_bits() -> None:
    assert 111 <= frame_bits(0x555, bytes([0x55] * 8)) <= frame_bits(0, bytes(8)) <= 135


def test_the_load_counts_each_frame_once_in_its_cycle() -> None:
    data = bytes(range(8))
    bits = frame_bits(0x100, data)
    load = bus_load([(0x100, data, 1), (0x100, data, 4)], 500_000)
    assert load == pytest.approx(1.25 * bits / (PERIOD_S * 500_000))
