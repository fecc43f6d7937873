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
from math import isnan, nan
from typing import NamedTuple

from cantools.database.can import Database, Message

from rt_controller.bus.dbc import data_id_of, data_ids_of, misfit
from rt_controller.bus.end_to_end.profile_5 import Profile5
from rt_controller.bus.end_to_end.profile_22 import FRAME_LENGTH, Profile22
from rt_controller.bus.end_to_end.protection import Frame, Place, Protection
from rt_controller.bus.signal_layout import signal_layout, struct_format
from rt_controller.contract.timing import LONG_COUNTER_MODULUS

VALID = 1
"""lowest bit of the flags, where that is the Valid flag"""
_VALID_FLAG = "Valid"


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


class FrameCodec:
    """Encodes and decodes one frame of the DBC: of classic CAN, or of CAN FD."""

    def __init__(self, database: Database, spec: FrameSpec) -> None:
        """Compile the layout.

        Raises:
            ConfigError: the DBC lacks the frame, or has a layout that is not supported here.
        """
        message = _find_message(database, spec.name)
        self.name: str = message.name
        self.sender: str = ", ".join(message.senders)
        self.arbitration_id: int = message.frame_id
        self.is_fd: bool = message.is_fd
        self.length: int = message.length
        """bytes of a frame"""
        self.protection: Protection = (
            Profile5(data_id_of(message), message.length)
            if message.is_fd
            else Profile22(data_ids_of(message))
        )
        self.is_intact = self.protection.is_intact
        self._flag = spec.flag
        self._has_valid_flag = spec.flag == _VALID_FLAG
        _require_layout(message, spec, self.protection.places(self._has_valid_flag))
        body = sorted(message.signals, key=lambda signal: signal.start)[-len(spec.signals) :]
        self.signals = tuple(signal_layout(self.name, signal) for signal in body)
        self._has_cycle = self._has_valid_flag and not message.is_fd
        self.counter_modulus = LONG_COUNTER_MODULUS if self._has_cycle else self.protection.modulus
        """number of counters that `counter_of` distinguishes"""
        self._usable_flags = self._find_usable_flags(message)
        self.n_values = len(body) + (0 if self._has_valid_flag else 1)
        """of `read` and `write`"""
        self.required = tuple(name for name in spec.signals if name not in spec.optional)
        """signals without which the frame is not used"""
        self._required_places = [spec.signals.index(name) for name in self.required]
        first_bit, n_bits = self.protection.head_bits, 8 * self.length
        self._struct = struct.Struct(
            self.protection.head_format + struct_format(self.name, body, first_bit, n_bits)
        )
        self._head_values = len(self.protection.head(0, 0))
        # Half an LSB of tolerance: a value that rounds into the range is in range.
        self._encode_rules = tuple(
            (s.scale, s.offset, s.raw_min - 0.5, s.raw_max + 0.5, s.raw_not_available)
            for s in self.signals
        )
        self._decode_rules = tuple((s.scale, s.offset, s.raw_min, s.raw_max) for s in self.signals)

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
        frame = bytearray(self._struct.pack(*self.protection.head(counter, flags), *raws))
        self.protection.protect(frame)
        return bytes(frame)

    def decode(self, frame: Frame) -> tuple[float, ...]:
        """Physical values in the order of `signals`; NaN where not available or out of range.

        The frame has the length of the message; CRC, counter and flags are not checked.
        """
        raws = self._struct.unpack(frame)[self._head_values :]
        return tuple(
            [
                raw * scale + offset if low <= raw <= high else nan
                for raw, (scale, offset, low, high) in zip(raws, self._decode_rules, strict=True)
            ]
        )

    def write(self, values: tuple[float, ...], counter: int, is_valid: bool = True) -> bytes:
        """Protected frame; without a Valid flag `values` begin with the flags, an integer.

        The counter is taken modulo `counter_modulus`.
        """
        cycle, counter = divmod(counter % self.counter_modulus, self.protection.modulus)
        if self._has_valid_flag:
            return self.encode(values, counter, is_valid | cycle << 1)
        return self.encode(values[1:], counter, int(values[0]))

    def counter_of(self, frame: Frame) -> int:
        """Counter of an intact frame, with the cycle where it has one: below `counter_modulus`."""
        counter = self.protection.counter_of(frame)
        if not self._has_cycle:
            return counter
        return counter | (self.protection.flags_of(frame) >> 1) * self.protection.modulus

    def flag_of(self, frame: Frame) -> int:
        """Valid or Mode of an intact frame."""
        flags = self.protection.flags_of(frame)
        return flags & VALID if self._has_cycle else flags

    def read(self, frame: Frame) -> tuple[float, ...] | None:
        """The values of an intact frame, as `write` takes them.

        None if the sender marked the frame as invalid, the flags are out of range, or a signal that
        is not optional is NaN.
        """
        flag = self.flag_of(frame)
        if flag not in self._usable_flags:
            return None
        values = self.decode(frame)
        if isnan(sum(values)) and any(isnan(values[i]) for i in self._required_places):
            return None
        return values if self._has_valid_flag else (flag, *values)

    def objections(self, frame: Frame) -> str:
        """Why `read` does not return the values of this intact frame, for people."""
        flag = self.flag_of(frame)
        raws = self._struct.unpack(frame)[self._head_values :]
        found = [self.signals[i].objection(raws[i]) for i in self._required_places]
        if flag not in self._usable_flags:
            usable = ", ".join(map(str, sorted(self._usable_flags)))
            found = [f"{self._flag}: expected {usable}, found {flag}"]
        return f"{self.name}: {'; '.join(each for each in found if each)}"

    def _find_usable_flags(self, message: Message) -> frozenset[int]:
        if self._has_valid_flag:
            return frozenset({VALID})
        signal = message.get_signal_by_name(self._flag)
        if signal.minimum is None or signal.maximum is None:
            raise misfit(f"{message.name}.{self._flag}", "with a declared range", "none")
        return frozenset(range(round(signal.minimum), round(signal.maximum) + 1))


def _find_message(database: Database, name: str) -> Message:
    try:
        message = database.get_message_by_name(name)
    except KeyError as error:
        raise misfit(name, "in the catalogue", "no such message") from error
    if message.is_extended_frame or not (message.is_fd or message.length == FRAME_LENGTH):
        found = f"{message.length} bytes under id {message.frame_id:#x}"
        expected = "of CAN FD, or as a classic frame of eight bytes, with an 11-bit id"
        raise misfit(name, expected, found)
    if not message.cycle_time:
        raise misfit(name, "with a GenMsgCycleTime", "none")
    return message


def _require_layout(message: Message, spec: FrameSpec, head: tuple[Place, ...]) -> None:
    signals = sorted(message.signals, key=lambda signal: signal.start)
    found = tuple(signal.name for signal in signals)
    expected = (*(place.name for place in head), *spec.signals)
    if found != expected:
        raise misfit(spec.name, f"with the signals {', '.join(expected)}", ", ".join(found))
    places = tuple((s.name, s.start, s.length) for s in signals[: len(head)])
    if places != head:
        raise misfit(spec.name, f"with the header {head}", str(places))
