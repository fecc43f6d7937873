"""Bits and bytes: a fast codec for every message, compiled from the DBC when the program starts.

The DBC is the only place where a layout is written down. cantools reads it; what the loop needs
of it (struct format, scale, range) is kept here in tuples. What a message means is the business
of `frames`.

A value that cannot travel (not a number, out of range) becomes the raw value that the DBC names
NotAvailable instead of being clipped: a clipped value looks like a measurement, a missing one
does not. The receiver turns NotAvailable, and every raw value outside the declared range, into NaN.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

from cantools.database.can import Database, Message, Signal

from rt_controller.bus.crc import frame_crc
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import COUNTER_MODULUS

DBC_PATH = Path(__file__).parents[1] / "contract" / "messages.dbc"

FRAME_LENGTH = 8
_HEADER = (("Crc", 0, 8), ("Counter", 8, 4))
_NIBBLE_PLACE = (12, 4)
_STRUCT_CODES = {
    (8, False): "B",
    (8, True): "b",
    (16, False): "H",
    (16, True): "h",
    (32, False): "I",
    (32, True): "i",
}
_NOT_AVAILABLE = "NotAvailable"

Frame = bytes | bytearray


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """How one signal is scaled and which raw values count; physical = raw * scale + offset."""

    name: str
    unit: str
    scale: float
    offset: float
    raw_min: int
    raw_max: int
    raw_not_available: int


class MessageCodec:
    """Encodes and decodes one message of the catalogue."""

    __slots__ = (
        "_decode_rules",
        "_encode_rules",
        "_struct",
        "arbitration_id",
        "cycle_ms",
        "data_ids",
        "name",
        "signals",
    )

    def __init__(
        self,
        *,
        name: str,
        arbitration_id: int,
        cycle_ms: int,
        data_ids: bytes,
        signals: tuple[SignalLayout, ...],
        struct_format: str,
    ) -> None:
        self.name = name
        self.arbitration_id = arbitration_id
        self.cycle_ms = cycle_ms
        self.data_ids = data_ids
        self.signals = signals
        self._struct = struct.Struct(struct_format)
        # Half an LSB of grace: a value that rounds into the range is in it.
        self._encode_rules = tuple(
            (s.scale, s.offset, s.raw_min - 0.5, s.raw_max + 0.5, s.raw_not_available)
            for s in signals
        )
        self._decode_rules = tuple((s.scale, s.offset, s.raw_min, s.raw_max) for s in signals)

    def encode(self, values: Sequence[float], counter: int, nibble: int) -> bytes:
        """Protected frame with these physical values, in the order of `signals`.

        Args:
            values: one for each signal; NaN and out of range travel as NotAvailable.
            counter: 0..15.
            nibble: Mode or Valid, whatever this message has in its high nibble.
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

        The frame has eight bytes; CRC, counter and nibble are not looked at.
        """
        _, *raws = self._struct.unpack(frame)
        return tuple(
            [
                raw * scale + offset if low <= raw <= high else nan
                for raw, (scale, offset, low, high) in zip(raws, self._decode_rules, strict=True)
            ]
        )

    def is_intact(self, frame: Frame) -> bool:
        """Whether the frame is whole and its CRC fits this message and its counter."""
        return (
            len(frame) == FRAME_LENGTH
            and frame_crc(frame, self.data_ids[counter_of(frame)]) == frame[0]
        )


def counter_of(frame: Frame) -> int:
    """The counter of a frame, 0..15."""
    return frame[1] & 0x0F


def nibble_of(frame: Frame) -> int:
    """The high nibble of byte 1: Mode or Valid."""
    return frame[1] >> 4


def read_catalogue(path: Path) -> Database:
    """The message catalogue of a DBC file, checked for overlapping signals.

    Raises:
        ConfigError: the file is missing or is no DBC.
    """
    database = Database(strict=True)
    try:
        database.add_dbc_string(path.read_text(encoding="ascii"))
    except Exception as error:  # parsing and linking fail in many kinds
        raise ConfigError(
            f"{path}: expected the message catalogue as a DBC file in ASCII, found {error}. "
            f"Restore the file that came with this version."
        ) from error
    return database


def compile_codec(
    catalogue: Database, name: str, nibble: str, signals: tuple[str, ...]
) -> MessageCodec:
    """The codec of one message.

    Args:
        catalogue: from `read_catalogue`.
        name: of the message in the DBC.
        nibble: name of the signal in the high nibble of byte 1.
        signals: the other signals that the caller expects, in their order on the wire.

    Raises:
        ConfigError: the DBC lacks the message, or lays it out in a way this codec cannot speak.
    """
    try:
        message = catalogue.get_message_by_name(name)
    except KeyError as error:
        raise _misfit(name, "in the catalogue", "no such message") from error
    by_place = sorted(message.signals, key=lambda signal: signal.start)
    found = tuple(signal.name for signal in by_place)
    expected = (*(header for header, _, _ in _HEADER), nibble, *signals)
    if found != expected:
        raise _misfit(name, f"with the signals {', '.join(expected)}", ", ".join(found))
    if message.length != FRAME_LENGTH or message.is_extended_frame or message.is_fd:
        found_frame = f"{message.length} bytes under id {message.frame_id:#x}"
        raise _misfit(name, "as a classic frame of eight bytes with an 11-bit id", found_frame)
    if not message.cycle_time:
        raise _misfit(name, "with a GenMsgCycleTime", "none")

    header, body = by_place[: len(_HEADER) + 1], by_place[len(_HEADER) + 1 :]
    places = [(signal.name, signal.start, signal.length) for signal in header]
    expected_places = [*_HEADER, (nibble, *_NIBBLE_PLACE)]
    if places != expected_places:
        raise _misfit(name, f"with the header {expected_places}", str(places))
    return MessageCodec(
        name=name,
        arbitration_id=message.frame_id,
        cycle_ms=message.cycle_time,
        data_ids=_data_ids(message),
        signals=tuple(_signal_layout(name, signal) for signal in body),
        struct_format=_struct_format(name, body),
    )


def _data_ids(message: Message) -> bytes:
    attributes = message.dbc.attributes if message.dbc is not None else {}
    text = str(attributes["E2EDataIdList"].value) if "E2EDataIdList" in attributes else ""
    try:
        data_ids = bytes.fromhex(text)
    except ValueError:
        data_ids = b""
    if len(data_ids) != COUNTER_MODULUS:
        raise _misfit(message.name, "with 16 hexadecimal bytes in E2EDataIdList", repr(text))
    return data_ids


def _signal_layout(message: str, signal: Signal) -> SignalLayout:
    name = f"{message}.{signal.name}"
    if signal.minimum is None or signal.maximum is None:
        raise _misfit(name, "with a declared range", "none")
    not_available = [
        raw for raw, text in (signal.choices or {}).items() if str(text) == _NOT_AVAILABLE
    ]
    if len(not_available) != 1:
        raise _misfit(name, f"with one raw value {_NOT_AVAILABLE}", str(not_available))
    layout = SignalLayout(
        name=signal.name,
        unit=signal.unit or "",
        scale=signal.scale,
        offset=signal.offset,
        raw_min=round((signal.minimum - signal.offset) / signal.scale),
        raw_max=round((signal.maximum - signal.offset) / signal.scale),
        raw_not_available=not_available[0],
    )
    if layout.raw_min <= layout.raw_not_available <= layout.raw_max:
        raise _misfit(name, f"with a range without {_NOT_AVAILABLE}", str(layout))
    return layout


def _struct_format(message: str, body: Sequence[Signal]) -> str:
    """Format of bytes 1 to 7, with byte 0 left free for the CRC."""
    parts = ["<xB"]
    bit = 16
    for signal in body:
        code = _STRUCT_CODES.get((signal.length, signal.is_signed))
        is_little_endian = signal.byte_order == "little_endian"
        if code is None or signal.start % 8 or signal.is_float or not is_little_endian:
            raise _misfit(
                f"{message}.{signal.name}",
                "as a little-endian integer of 8, 16 or 32 bits that starts with a byte",
                f"{signal.start}|{signal.length} {signal.byte_order}",
            )
        parts.append("x" * ((signal.start - bit) // 8) + code)
        bit = signal.start + signal.length
    parts.append("x" * ((FRAME_LENGTH * 8 - bit) // 8))
    return "".join(parts)


def _misfit(subject: str, expected: str, found: str) -> ConfigError:
    return ConfigError(
        f"messages.dbc: expected {subject} {expected}, found {found}. "
        f"Restore the file that came with this version, or adapt rt_controller.bus to the new one."
    )
