"""Encoding, decoding and checking of single frames, compiled from the DBC when the program starts.

The DBC is the only place where a layout is written down. cantools reads it; what the loop needs of
it (struct format, scale, range) is kept here in tuples. `messages` says what the values mean.
`tests/bus/test_dbc.py` checks that the DBC has no layout but those that are supported here.

A value that cannot be sent (not finite, or out of range) becomes the raw value that the DBC calls
NotAvailable instead of being clipped, because a clipped value looks like a measurement. The
receiver turns NotAvailable, and every raw value outside the declared range, into NaN.

Frames are protected by AUTOSAR's end-to-end profile 22: CRC-8, a counter of four bits, 16 data ids
for each message. Source: AUTOSAR FO PRS E2EProtocol.
"""

import struct
from collections.abc import Sequence
from math import nan
from typing import NamedTuple

from cantools.database.can import Database, Message, Signal

from rt_controller.bus.dbc import data_ids_of
from rt_controller.contract.crc8 import crc8_table
from rt_controller.contract.timing import COUNTER_MODULUS, LONG_COUNTER_MODULUS

Frame = bytes | bytearray

VALID = 1
"""lowest bit of the flags, where that is the Valid flag"""
_VALID_FLAG = "Valid"
NOT_AVAILABLE = "NotAvailable"
FRAME_LENGTH = 8
LARGEST_FLAGS = 15
COUNTER_MASK = 0x0F
"""of byte 1; the flags are in the high nibble"""
DAMAGED = -1
"""instead of a counter: the length or the checksum is wrong"""
_HEAD_BITS = 16
"""CRC, counter and flags"""
_STRUCT_CODES = {8: "b", 16: "h", 32: "i"}
"""of signed integers, by bits; unsigned ones have capital letters"""
_TABLE = crc8_table(0x2F)


def crc8(frame: Frame, data_id: int) -> int:
    """Byte 0 of a frame: the CRC-8 of its other seven bytes and of the data id.

    The polynomial is 0x2F, start and final value are all ones, without reflection. AUTOSAR calls it
    CRC8H2F and uses it in profiles 2 and 22. It detects every error of up to three bits outside the
    counter. The data id, one byte that is not transmitted, depends on frame and counter: an intact
    frame under the id of another one fails the check. The data ids in the DBC are chosen so that
    every error of one or two bits anywhere is detected as well.
    """
    t = _TABLE
    _, a, b, c, d, e, f, g = frame  # written out: a loop would take twice as long
    return t[t[t[t[t[t[t[t[0xFF ^ a] ^ b] ^ c] ^ d] ^ e] ^ f] ^ g] ^ data_id] ^ 0xFF


class FrameSpec(NamedTuple):
    """What the program expects of one frame of the DBC."""

    name: str
    flag: str
    """signal beside the counter: "Valid", or one that belongs to the content"""
    signals: tuple[str, ...]
    """the other signals, in their order in the frame"""
    optional: tuple[str, ...] = ()
    """signals that may be not available, NaN for `decode`; if another one is, the frame is not
    used"""


class SignalLayout(NamedTuple):
    """Scaling and valid raw values of one signal; physical = raw * scale + offset."""

    name: str
    scale: float
    offset: float
    raw_min: int
    raw_max: int
    raw_not_available: int
    unit: str

    def objection(self, raw: int) -> str:
        """Why this raw value may not be used; empty if it may."""
        if self.raw_min <= raw <= self.raw_max:
            return ""
        ends = (self.raw_min, self.raw_max, raw)
        low, high, value = (each * self.scale + self.offset for each in ends)
        is_missing = raw == self.raw_not_available  # a sender cannot send a value beyond the range
        found = "none or one beyond it" if is_missing else f"{value:g}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name}: expected a value of {low:g} to {high:g}{unit}, found {found}"


class FrameCodec:
    """Encodes, checks and decodes one frame of the DBC."""

    def __init__(self, database: Database, spec: FrameSpec) -> None:
        """Compile the layout."""
        message = database.get_message_by_name(spec.name)
        self.name: str = message.name
        self.sender: str = ", ".join(message.senders)
        self.arbitration_id: int = message.frame_id
        self.data_ids = data_ids_of(message)
        """one for each counter"""
        self._flag = spec.flag
        self._has_valid_flag = spec.flag == _VALID_FLAG
        """beside it are three more bits of the counter: the cycle"""
        self.counter_modulus = LONG_COUNTER_MODULUS if self._has_valid_flag else COUNTER_MODULUS
        """number of counters that `check` distinguishes"""
        self._usable_flags = _usable_flags(message, spec.flag)
        body = [message.get_signal_by_name(name) for name in spec.signals]
        self.signals = tuple(map(_signal_layout, body))
        self.n_values = len(body) + (0 if self._has_valid_flag else 1)
        """of `read` and `write`"""
        self.required = tuple(name for name in spec.signals if name not in spec.optional)
        """signals without which the frame is not used"""
        self._required_places = [spec.signals.index(name) for name in self.required]
        self._flag_mask = VALID if self._has_valid_flag else LARGEST_FLAGS
        codes = _struct_format(body)
        self._struct = struct.Struct("<xB" + codes)
        self._body = struct.Struct("<xx" + codes)
        """without counter and flags"""
        # Half an LSB of tolerance: a value that rounds into the range is in range.
        self._encode_rules = tuple(
            (s.scale, s.offset, s.raw_min - 0.5, s.raw_max + 0.5, s.raw_not_available)
            for s in self.signals
        )
        self._read_rules = tuple(
            (s.scale, s.offset, s.raw_min, s.raw_max, s.name in self.required) for s in self.signals
        )

    def encode(self, values: Sequence[float], counter: int, flags: int) -> bytes:
        """Protected frame with these physical values, in the order of `signals`.

        Args:
            values: one for each signal; NaN and out of range are sent as NotAvailable.
            counter: of the protection, below its modulus.
            flags: beside the counter.
        """
        raws = [
            round(raw) if low < (raw := (value - offset) / scale) < high else not_available
            for value, (scale, offset, low, high, not_available) in zip(
                values, self._encode_rules, strict=True
            )
        ]
        frame = bytearray(self._struct.pack(flags << 4 | counter, *raws))
        frame[0] = crc8(frame, self.data_ids[counter])
        return bytes(frame)

    def write(self, values: tuple[float, ...], counter: int, is_valid: bool = True) -> bytes:
        """Protected frame; without a Valid flag `values` begin with the flags, an integer.

        The counter is taken modulo `counter_modulus`.
        """
        cycle, counter = divmod(counter % self.counter_modulus, COUNTER_MODULUS)
        if self._has_valid_flag:
            return self.encode(values, counter, is_valid | cycle << 1)
        return self.encode(values[1:], counter, int(values[0]))

    def check(self, frame: Frame) -> int:
        """Counter of an intact frame, with the cycle where it has one; `DAMAGED` if it is not."""
        if len(frame) != FRAME_LENGTH:
            return DAMAGED
        head = frame[1]
        counter = head & COUNTER_MASK
        if crc8(frame, self.data_ids[counter]) != frame[0]:
            return DAMAGED
        return counter | (head >> 5) * COUNTER_MODULUS if self._has_valid_flag else counter

    def read(self, frame: Frame) -> tuple[float, ...] | None:
        """The values of an intact frame, as `write` takes them.

        None if the sender marked the frame as invalid, the flags are out of range, or a signal that
        is not optional is NaN.
        """
        flag = frame[1] >> 4 & self._flag_mask
        if flag not in self._usable_flags:
            return None
        values: list[float] = [] if self._has_valid_flag else [flag]
        for raw, (scale, offset, low, high, is_required) in zip(
            self._body.unpack(frame), self._read_rules, strict=True
        ):
            if low <= raw <= high:
                values.append(raw * scale + offset)
            elif is_required:
                return None
            else:
                values.append(nan)
        return tuple(values)

    def decode(self, frame: Frame) -> tuple[float, ...]:
        """Physical values in the order of `signals`; NaN where not available or out of range.

        The frame has the length of the message; CRC, counter and flags are not checked.
        """
        return tuple(
            [
                raw * scale + offset if low <= raw <= high else nan
                for raw, (scale, offset, low, high, _) in zip(
                    self._body.unpack(frame), self._read_rules, strict=True
                )
            ]
        )

    def flag_of(self, frame: Frame) -> int:
        """Valid or Mode of an intact frame."""
        return frame[1] >> 4 & self._flag_mask

    def objections(self, frame: Frame) -> str:
        """Why `read` does not return the values of this intact frame, for people."""
        flag = self.flag_of(frame)
        raws = self._body.unpack(frame)
        found = [self.signals[i].objection(raws[i]) for i in self._required_places]
        if flag not in self._usable_flags:
            usable = ", ".join(map(str, sorted(self._usable_flags)))
            found = [f"{self._flag}: expected {usable}, found {flag}"]
        return f"{self.name}: {'; '.join(each for each in found if each)}"


def _usable_flags(message: Message, flag: str) -> frozenset[int]:
    if flag == _VALID_FLAG:
        return frozenset({VALID})
    low, high = _range(message.get_signal_by_name(flag))
    return frozenset(range(round(low), round(high) + 1))


def _range(signal: Signal) -> tuple[float, float]:
    """The declared range of a signal, which every signal of the catalogue has."""
    return float(signal.minimum or 0.0), float(signal.maximum or 0.0)


def _signal_layout(signal: Signal) -> SignalLayout:
    low, high = _range(signal)
    names = dict(signal.choices or {})
    (not_available,) = (raw for raw, name in names.items() if str(name) == NOT_AVAILABLE)
    return SignalLayout(
        name=signal.name,
        scale=signal.scale,
        offset=signal.offset,
        raw_min=round((low - signal.offset) / signal.scale),
        raw_max=round((high - signal.offset) / signal.scale),
        raw_not_available=not_available,
        unit=signal.unit or "",
    )


def _struct_format(body: Sequence[Signal]) -> str:
    """struct format of the signals behind the head of a frame."""
    parts = []
    bit = _HEAD_BITS
    for signal in body:
        code = _STRUCT_CODES[signal.length]
        padding = "x" * ((signal.start - bit) // 8)
        parts.append(padding + (code if signal.is_signed else code.upper()))
        bit = signal.start + signal.length
    return "".join(parts) + "x" * ((8 * FRAME_LENGTH - bit) // 8)
