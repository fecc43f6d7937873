"""Encoding and decoding of single frames, compiled from the DBC when the program starts.

The DBC is the only place where a layout is written down. cantools reads it; what the loop needs
of it (struct format, scale, range) is kept here in tuples. The meaning of the values is defined in
`catalogue`.

A value that cannot be sent (not finite, or out of range) becomes the raw value that the DBC calls
NotAvailable instead of being clipped, because a clipped value looks like a measurement. The
receiver turns NotAvailable, and every raw value outside the declared range, into NaN.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import NamedTuple

from cantools.database.can import Database, Message, Signal

from rt_controller.bus.dbc import data_ids_of, misfit

_POLYNOMIAL = 0x2F
_ALL_ONES = 0xFF


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (_POLYNOMIAL if byte & 0x80 else 0)
    return byte & 0xFF


_TABLE = tuple(_remainder(byte) for byte in range(256))


def frame_crc(frame: bytes | bytearray, data_id: int) -> int:
    """Byte 0 of an eight-byte frame: the CRC-8 of its other bytes and of the data id.

    The polynomial is 0x2F, start and final value are all ones, without reflection. AUTOSAR calls it
    CRC8H2F and uses it in profiles 2 and 22. It detects every error of up to three bits outside the
    counter. The data id, one byte that is not transmitted, depends on frame and counter: an intact
    frame under the id of another one fails the check. The data ids in the DBC are chosen so that
    every error of one or two bits anywhere is detected as well.
    """
    t = _TABLE
    _, a, b, c, d, e, f, g = frame  # written out: a loop would take twice as long
    return t[t[t[t[t[t[t[t[_ALL_ONES ^ a] ^ b] ^ c] ^ d] ^ e] ^ f] ^ g] ^ data_id] ^ _ALL_ONES


FRAME_LENGTH = 8
COUNTER_MASK = 0x0F
"""of byte 1"""
VALID = 1
"""high nibble of byte 1, where that is the Valid flag"""
_HEADER = (("Crc", 0, 8), ("Counter", 8, 4))
_NIBBLE_PLACE = (12, 4)
_VALID_NIBBLE = "Valid"
_STRUCT_CODES = {8: "b", 16: "h", 32: "i"}
"""of signed integers, by bits; unsigned ones have capital letters"""
_NOT_AVAILABLE = "NotAvailable"

Frame = bytes | bytearray


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Scaling and valid raw values of one signal; physical = raw * scale + offset."""

    name: str
    scale: float
    offset: float
    raw_min: int
    raw_max: int
    raw_not_available: int
    unit: str

    def objection(self, raw: int) -> str | None:
        """Why this raw value may not be used; None if it may."""
        if self.raw_min <= raw <= self.raw_max:
            return None
        ends = (self.raw_min, self.raw_max, raw)
        low, high, value = (each * self.scale + self.offset for each in ends)
        is_missing = raw == self.raw_not_available  # a sender cannot send a value beyond the range
        found = "none or one beyond it" if is_missing else f"{value:g}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name}: expected a value of {low:g} to {high:g}{unit}, found {found}"


class FrameSpec(NamedTuple):
    """What the program expects of one frame of the DBC."""

    name: str
    nibble: str
    """signal in the high nibble of byte 1: "Valid", or one that belongs to the content"""
    signals: tuple[str, ...]
    """the other signals, in their order in the frame"""
    optional: tuple[str, ...] = ()
    """signals that may be not available, NaN for `decode`; if another one is, the frame is not
    used"""


class FrameCodec:
    """Encodes and decodes one frame of the DBC."""

    def __init__(self, database: Database, spec: FrameSpec) -> None:
        """Compile the layout.

        Raises:
            ConfigError: the DBC lacks the frame, or has a layout that is not supported here.
        """
        message = _find_message(database, spec)
        body = sorted(message.signals, key=lambda signal: signal.start)[len(_HEADER) + 1 :]
        self.name: str = message.name
        self.sender: str = ", ".join(message.senders)
        self.arbitration_id: int = message.frame_id
        self.data_ids = data_ids_of(message)
        self.signals = tuple(_signal_layout(self.name, signal) for signal in body)
        self._nibble = spec.nibble
        self._has_valid_flag = spec.nibble == _VALID_NIBBLE
        self._usable_nibbles = _usable_nibbles(message, spec.nibble)
        self.n_values = len(body) + (0 if self._has_valid_flag else 1)
        """of `read` and `write`"""
        self.required = tuple(name for name in spec.signals if name not in spec.optional)
        """signals without which the frame is not used"""
        self._required_places = [spec.signals.index(name) for name in self.required]
        self._struct = struct.Struct(_struct_format(self.name, body))
        # Half an LSB of tolerance: a value that rounds into the range is in range.
        self._encode_rules = tuple(
            (s.scale, s.offset, s.raw_min - 0.5, s.raw_max + 0.5, s.raw_not_available)
            for s in self.signals
        )
        self._decode_rules = tuple((s.scale, s.offset, s.raw_min, s.raw_max) for s in self.signals)

    def encode(self, values: Sequence[float], counter: int, nibble: int) -> bytes:
        """Protected frame with these physical values, in the order of `signals`.

        Args:
            values: one for each signal; NaN and out of range are sent as NotAvailable.
            counter: 0..15.
            nibble: high nibble of byte 1.
        """
        raws = [
            round(raw) if low < (raw := (value - offset) / scale) < high else not_available
            for value, (scale, offset, low, high, not_available) in zip(
                values, self._encode_rules, strict=True
            )
        ]
        frame = bytearray(self._struct.pack(nibble << 4 | counter, *raws))
        frame[0] = frame_crc(frame, self.data_ids[counter])
        return bytes(frame)

    def decode(self, frame: Frame) -> tuple[float, ...]:
        """Physical values in the order of `signals`; NaN where not available or out of range.

        The frame has eight bytes; CRC, counter and nibble are not checked.
        """
        _, *raws = self._struct.unpack(frame)
        return tuple(
            [
                raw * scale + offset if low <= raw <= high else nan
                for raw, (scale, offset, low, high) in zip(raws, self._decode_rules, strict=True)
            ]
        )

    def write(self, values: tuple[float, ...], counter: int, is_valid: bool = True) -> bytes:
        """Protected frame; without a Valid flag `values` begin with the nibble, an integer."""
        if self._has_valid_flag:
            return self.encode(values, counter, is_valid)
        return self.encode(values[1:], counter, int(values[0]))

    def read(self, frame: Frame) -> tuple[float, ...] | None:
        """The values of an intact frame, as `write` takes them.

        None if the sender marked the frame as invalid, the nibble is out of range, or a signal that
        is not optional is NaN.
        """
        nibble = frame[1] >> 4
        if nibble not in self._usable_nibbles:
            return None
        values = self.decode(frame)
        if isnan(sum(values)) and any(isnan(values[i]) for i in self._required_places):
            return None
        return values if self._has_valid_flag else (nibble, *values)

    def objections(self, frame: Frame) -> str:
        """Why `read` does not return the values of this intact frame, for people."""
        nibble = frame[1] >> 4
        _, *raws = self._struct.unpack(frame)
        found = [self.signals[i].objection(raws[i]) for i in self._required_places]
        if nibble not in self._usable_nibbles:
            usable = ", ".join(map(str, sorted(self._usable_nibbles)))
            found = [f"{self._nibble}: expected {usable}, found {nibble}"]
        return f"{self.name}: {'; '.join(each for each in found if each)}"

    def is_intact(self, frame: Frame) -> bool:
        """True if the frame has eight bytes and a CRC that fits this message and its counter."""
        return (
            len(frame) == FRAME_LENGTH
            and frame_crc(frame, self.data_ids[frame[1] & COUNTER_MASK]) == frame[0]
        )


def _find_message(database: Database, spec: FrameSpec) -> Message:
    name = spec.name
    try:
        message = database.get_message_by_name(name)
    except KeyError as error:
        raise misfit(name, "in the catalogue", "no such message") from error
    signals = sorted(message.signals, key=lambda signal: signal.start)
    header = (*_HEADER, (spec.nibble, *_NIBBLE_PLACE))
    found = tuple(signal.name for signal in signals)
    expected = (*(header_name for header_name, _, _ in header), *spec.signals)
    if found != expected:
        raise misfit(name, f"with the signals {', '.join(expected)}", ", ".join(found))
    if message.length != FRAME_LENGTH or message.is_extended_frame or message.is_fd:
        found_frame = f"{message.length} bytes under id {message.frame_id:#x}"
        raise misfit(name, "as a classic frame of eight bytes with an 11-bit id", found_frame)
    if not message.cycle_time:
        raise misfit(name, "with a GenMsgCycleTime", "none")
    places = tuple((s.name, s.start, s.length) for s in signals[: len(header)])
    if places != header:
        raise misfit(name, f"with the header {header}", str(places))
    return message


def _usable_nibbles(message: Message, name: str) -> frozenset[int]:
    if name == _VALID_NIBBLE:
        return frozenset([VALID])
    signal = message.get_signal_by_name(name)
    if signal.minimum is None or signal.maximum is None:
        raise misfit(f"{message.name}.{name}", "with a declared range", "none")
    return frozenset(range(round(signal.minimum), round(signal.maximum) + 1))


def _signal_layout(message: str, signal: Signal) -> SignalLayout:
    name = f"{message}.{signal.name}"
    if signal.minimum is None or signal.maximum is None:
        raise misfit(name, "with a declared range", "none")
    not_available = [
        raw for raw, text in (signal.choices or {}).items() if str(text) == _NOT_AVAILABLE
    ]
    if len(not_available) != 1:
        raise misfit(name, f"with one raw value {_NOT_AVAILABLE}", str(not_available))
    layout = SignalLayout(
        name=signal.name,
        scale=signal.scale,
        offset=signal.offset,
        raw_min=round((signal.minimum - signal.offset) / signal.scale),
        raw_max=round((signal.maximum - signal.offset) / signal.scale),
        raw_not_available=not_available[0],
        unit=signal.unit or "",
    )
    if layout.raw_min <= layout.raw_not_available <= layout.raw_max:
        raise misfit(name, f"with a range without {_NOT_AVAILABLE}", str(layout))
    return layout


def _struct_format(message: str, body: Sequence[Signal]) -> str:
    """Format of bytes 1 to 7; byte 0 is left for the CRC."""
    parts = ["<xB"]
    bit = 16
    for signal in body:
        code = _STRUCT_CODES.get(signal.length)
        is_little_endian = signal.byte_order == "little_endian"
        if code is None or signal.start % 8 or signal.is_float or not is_little_endian:
            raise misfit(
                f"{message}.{signal.name}",
                "as a little-endian integer of 8, 16 or 32 bits that starts with a byte",
                f"{signal.start}|{signal.length} {signal.byte_order}",
            )
        padding = "x" * ((signal.start - bit) // 8)
        parts.append(padding + (code if signal.is_signed else code.upper()))
        bit = signal.start + signal.length
    parts.append("x" * ((FRAME_LENGTH * 8 - bit) // 8))
    return "".join(parts)
