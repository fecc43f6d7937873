"""Encoding, decoding and checking of single frames, compiled from the DBC when the program starts.

The DBC is the only place where a layout is written down. cantools reads it; what the loop needs of
it (struct format, scale, range) is kept here in tuples. `messages` says what the values mean.

A value that cannot be sent (not finite, or out of range) becomes the raw value that the DBC calls
NotAvailable instead of being clipped, because a clipped value looks like a measurement. The
receiver turns NotAvailable, and every raw value outside the declared range, into NaN.

Frames are protected by AUTOSAR's end-to-end profiles: classic CAN by profile 22 (CRC-8, a counter
of four bits, 16 data ids for each message), CAN FD by profile 5 (CRC-16, a counter of eight bits,
one data id of 16 bits). Source: AUTOSAR FO PRS E2EProtocol.
"""

import struct
from binascii import crc_hqx
from collections.abc import Sequence
from math import nan
from typing import NamedTuple

from cantools.database.can import Database, Message, Signal

from rt_controller.bus.dbc import data_id_of, data_ids_of, misfit
from rt_controller.contract.timing import COUNTER_MODULUS, LONG_COUNTER_MODULUS

Frame = bytes | bytearray

VALID = 1
"""lowest bit of the flags, where that is the Valid flag"""
_VALID_FLAG = "Valid"
NOT_AVAILABLE = "NotAvailable"
FRAME_LENGTH = 8
"""of classic CAN"""
COUNTER_MASK = 0x0F
"""of byte 1 of a classic frame; the flags are in the high nibble"""
DAMAGED = -1
"""instead of a counter: the length or the checksum is wrong"""
_STRUCT_CODES = {8: "b", 16: "h", 32: "i"}
"""of signed integers, by bits; unsigned ones have capital letters"""


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1) ^ (0x2F if byte & 0x80 else 0)
    return byte & 0xFF


_TABLE = tuple(_remainder(byte) for byte in range(256))


def crc8(frame: Frame, data_id: int) -> int:
    """Byte 0 of a classic frame: the CRC-8 of its other seven bytes and of the data id.

    The polynomial is 0x2F, start and final value are all ones, without reflection. AUTOSAR calls it
    CRC8H2F and uses it in profiles 2 and 22. It detects every error of up to three bits outside the
    counter. The data id, one byte that is not transmitted, depends on frame and counter: an intact
    frame under the id of another one fails the check. The data ids in the DBC are chosen so that
    every error of one or two bits anywhere is detected as well.
    """
    t = _TABLE
    _, a, b, c, d, e, f, g = frame  # written out: a loop would take twice as long
    return t[t[t[t[t[t[t[t[0xFF ^ a] ^ b] ^ c] ^ d] ^ e] ^ f] ^ g] ^ data_id] ^ 0xFF


def crc16(frame: Frame, data_id: int) -> int:
    """Bytes 0 and 1 of a frame of CAN FD, the lower one first: the CRC-16 of the other bytes.

    The polynomial is 0x1021, the start value is all ones, without reflection. It detects every
    error of up to three bits. The data id, two bytes that are not transmitted, comes last.
    """
    return crc_hqx(data_id.to_bytes(2, "little"), crc_hqx(frame[2:], 0xFFFF))


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
    """Encodes, checks and decodes one frame of the DBC: of classic CAN, or of CAN FD."""

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
        self.data_ids = b"" if message.is_fd else data_ids_of(message)
        """of profile 22, one for each counter"""
        self.data_id = data_id_of(message) if message.is_fd else 0
        """of profile 5"""
        self.largest_flags = 255 if message.is_fd else 15
        self._modulus = 256 if message.is_fd else COUNTER_MODULUS
        self._flag = spec.flag
        self._has_valid_flag = spec.flag == _VALID_FLAG
        body = _body(message, spec)
        self.signals = tuple(_signal_layout(self.name, signal) for signal in body)
        self._has_cycle = self._has_valid_flag and not message.is_fd
        self.counter_modulus = LONG_COUNTER_MODULUS if self._has_cycle else self._modulus
        """number of counters that `check` distinguishes"""
        self._usable_flags = self._find_usable_flags(message)
        self.n_values = len(body) + (0 if self._has_valid_flag else 1)
        """of `read` and `write`"""
        self.required = tuple(name for name in spec.signals if name not in spec.optional)
        """signals without which the frame is not used"""
        self._required_places = [spec.signals.index(name) for name in self.required]
        self._flag_byte, self._flag_shift = (3, 0) if message.is_fd else (1, 4)
        self._flag_mask = VALID if self._has_cycle else 0xFF
        head, head_bits = ("<xxBB", 32) if message.is_fd else ("<xB", 16)
        codes = _struct_format(self.name, body, head_bits, 8 * self.length)
        self._struct = struct.Struct(head + codes)
        self._body = struct.Struct(head.replace("B", "x") + codes)
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
        if self.is_fd:
            frame = bytearray(self._struct.pack(counter, flags, *raws))
            frame[:2] = crc16(frame, self.data_id).to_bytes(2, "little")
        else:
            frame = bytearray(self._struct.pack(flags << 4 | counter, *raws))
            frame[0] = crc8(frame, self.data_ids[counter])
        return bytes(frame)

    def write(self, values: tuple[float, ...], counter: int, is_valid: bool = True) -> bytes:
        """Protected frame; without a Valid flag `values` begin with the flags, an integer.

        The counter is taken modulo `counter_modulus`.
        """
        cycle, counter = divmod(counter % self.counter_modulus, self._modulus)
        if self._has_valid_flag:
            return self.encode(values, counter, is_valid | cycle << 1)
        return self.encode(values[1:], counter, int(values[0]))

    def check(self, frame: Frame) -> int:
        """Counter of an intact frame, with the cycle where it has one; `DAMAGED` if it is not."""
        if len(frame) != self.length:
            return DAMAGED
        if self.is_fd:
            is_intact = crc16(frame, self.data_id) == frame[0] | frame[1] << 8
            return frame[2] if is_intact else DAMAGED
        head = frame[1]
        counter = head & COUNTER_MASK
        if crc8(frame, self.data_ids[counter]) != frame[0]:
            return DAMAGED
        return counter | (head >> 5) * COUNTER_MODULUS if self._has_cycle else counter

    def read(self, frame: Frame) -> tuple[float, ...] | None:
        """The values of an intact frame, as `write` takes them.

        None if the sender marked the frame as invalid, the flags are out of range, or a signal that
        is not optional is NaN.
        """
        flag = frame[self._flag_byte] >> self._flag_shift & self._flag_mask
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
        return frame[self._flag_byte] >> self._flag_shift & self._flag_mask

    def objections(self, frame: Frame) -> str:
        """Why `read` does not return the values of this intact frame, for people."""
        flag = self.flag_of(frame)
        raws = self._body.unpack(frame)
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


def _body(message: Message, spec: FrameSpec) -> list[Signal]:
    """The signals behind the head; CRC, counter and flags have to stand where the profile says."""
    has_valid_flag = spec.flag == _VALID_FLAG
    if message.is_fd:
        flag = ("Valid" if has_valid_flag else "Mode", 24, 8)
        head: tuple[tuple[str, int, int], ...] = (("Crc", 0, 16), ("Counter", 16, 8), flag)
    else:
        flags = (("Valid", 12, 1), ("Cycle", 13, 3)) if has_valid_flag else (("Mode", 12, 4),)
        head = (("Crc", 0, 8), ("Counter", 8, 4), *flags)
    signals = sorted(message.signals, key=lambda signal: signal.start)
    found = tuple(signal.name for signal in signals)
    expected = (*(name for name, _, _ in head), *spec.signals)
    if found != expected:
        raise misfit(spec.name, f"with the signals {', '.join(expected)}", ", ".join(found))
    places = tuple((s.name, s.start, s.length) for s in signals[: len(head)])
    if places != head:
        raise misfit(spec.name, f"with the header {head}", str(places))
    return signals[len(head) :]


def _signal_layout(message: str, signal: Signal) -> SignalLayout:
    """The layout of a signal of this message.

    Raises:
        ConfigError: it has no range, not one raw value NotAvailable, or one inside of the range.
    """
    name = f"{message}.{signal.name}"
    if signal.minimum is None or signal.maximum is None:
        raise misfit(name, "with a declared range", "none")
    not_available = [
        raw for raw, text in (signal.choices or {}).items() if str(text) == NOT_AVAILABLE
    ]
    if len(not_available) != 1:
        raise misfit(name, f"with one raw value {NOT_AVAILABLE}", str(not_available))
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
        raise misfit(name, f"with a range without {NOT_AVAILABLE}", str(layout))
    return layout


def _struct_format(message: str, body: Sequence[Signal], first_bit: int, n_bits: int) -> str:
    """struct format of the signals of a frame of `n_bits` that begin at `first_bit`.

    Raises:
        ConfigError: a signal is not an integer of whole bytes.
    """
    parts = []
    bit = first_bit
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
    return "".join(parts) + "x" * ((n_bits - bit) // 8)
