"""Frames of a car's own messages: from and to SI values of the mapped signals."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from math import floor, isfinite, tau
from operator import xor

import can
import cantools
from cantools.database.can import Database, Message, Signal

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.car_file import Source, find_source
from rt_controller.mapping.measurement import ALLOWED_UNUSABLE_SHARE, Measurement, range_of
from rt_controller.mapping.slots import Slot, scaling_of
from rt_controller.mapping.tables import Checksum, ChecksumKind, MessageMapping

PERIODIC = "pose.yaw"
"""slot with an angle that a car may send in 0 to 360 deg, or in ±180 deg"""
MAX_FRAMES = 1024
"""kept in a queue; the oldest are dropped"""


class FrameQueue:
    """Frames that were sent, for a reader in the same thread.

    It keeps copies: a sender uses its frames again.
    """

    def __init__(self) -> None:
        self.frames: deque[can.Message] = deque(maxlen=MAX_FRAMES)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Keep a copy."""
        number, data = msg.arbitration_id, bytes(msg.data)
        self.frames.append(can.Message(0.0, number, msg.is_extended_id, data=data))


@dataclass(slots=True)
class ReadCounts:
    """Frames of one message since the start."""

    accepted: int = 0
    wrong_length: int = 0
    """shorter than the DBC says, or not decodable; dropped"""
    found_bytes: int = 0
    """of the last one of these"""
    wrong_checksum: int = 0
    """dropped"""
    repeated: int = 0
    """same counter as the frame before; dropped"""
    lost: int = 0
    """missing between two counters"""


class _Field(Measurement):
    """One slot in one message."""

    def to_raw(self, value: float) -> float:
        """The raw value that is sent for an SI value."""
        if self.on is not None:  # the smallest raw value that means this
            return min(self.on) if value > 0.5 else min(self.off or {0})
        number = self.from_si(value)
        low, high = range_of(self.signal)
        if self.slot.name == PERIODIC and isfinite(low) and not low <= number <= high:
            turn = abs(tau / self.scaling.factor)
            number -= turn * floor((number - low) / turn)
        return _raw(self.signal, number)


class _Frame:
    """A message with mapped signals, or one of its multiplexed forms."""

    def __init__(self, message: Message, settings: MessageMapping) -> None:
        self.message, self.settings = message, settings
        self.fields: list[_Field] = []
        self.raws: dict[str, float] = {}
        """of every signal of a frame that is sent"""
        self.counts = ReadCounts()
        self.last: int | None = None
        """counter of the newest frame that was read"""
        self.counter: Signal | None = None
        self.checksum_place: int | None = None
        if settings.counter is not None:
            self.counter = _require_signal(message, settings.counter, "counter")
        if settings.checksum is not None:
            self.checksum_place = _checksum_place(message, settings.checksum)

    def checksum(self, data: bytes | bytearray) -> int:
        """Over the data without its own byte, and the bytes that are not transmitted."""
        settings, place = self.settings.checksum, self.checksum_place
        if settings is None or place is None:
            return 0
        return _CHECKSUMS[settings.kind](
            bytes(data[:place]) + bytes(data[place + 1 :]) + bytes(settings.data_id)
        )


class SignalReader:
    """Decodes the messages that have mapped signals; frames of other ids are ignored."""

    def __init__(
        self,
        slots: Sequence[Slot],
        messages: Mapping[str, MessageMapping],
        database: Database,
        where: str,
    ) -> None:
        """Find every slot in the DBC.

        Raises:
            ConfigError: a column is not in the DBC; the message starts with `where`.
            DatasetError: a unit is missing or does not fit.
        """
        self.sources: dict[str, Source] = {}
        self.measurements: dict[str, Measurement] = {}
        """by slot"""
        self._frames: dict[tuple[int, bool], _Frame] = {}
        for message, field in _located(slots, database, where):
            self.sources[field.slot.name] = Source(message, field.signal)
            self.measurements[field.slot.name] = field
            key = message.frame_id, message.is_extended_frame
            if key not in self._frames:
                self._frames[key] = _Frame(message, messages.get(message.name, MessageMapping()))
            self._frames[key].fields.append(field)
        self.counts = {each.message.name: each.counts for each in self._frames.values()}

    def has(self, frame: can.Message) -> bool:
        """True if a slot is in messages with this identifier."""
        return (frame.arbitration_id, frame.is_extended_id) in self._frames

    def objection(self, name: str) -> tuple[str, str]:
        """Why the frames of a slot cannot be used, and what to do; empty: they can.

        Also if there are none.
        """
        message = self.sources[name].message
        counts, measured = self.counts[message.name], self.measurements[name]
        if counts.wrong_checksum > counts.accepted:
            return (
                f"{counts.wrong_checksum} frames of {message.name} with a wrong checksum",
                f"Correct [messages.{message.name}] checksum: kind, signal, data_id",
            )
        if counts.wrong_length > ALLOWED_UNUSABLE_SHARE * counts.accepted:
            return (
                f"{counts.wrong_length} frames of {message.name} have {counts.found_bytes} bytes, "
                f"the DBC says {message.length}",
                "Use the DBC of this car, or correct the length of the message in it",
            )
        if measured.samples:
            return "", ""
        kind = "29-bit" if message.is_extended_frame else "11-bit"
        problem = f"no sample: no frame of {message.name} ({kind} id {message.frame_id:#x})"
        if counts.accepted:
            problem = (
                f"no sample, although {message.name} arrives: its multiplexer value is not sent"
            )
        return problem, f"Check that the car sends it, and `column` of {measured.slot.name}"

    def read(self, frame: can.Message) -> dict[str, float] | None:
        """SI values of the slots in a frame, by name; NaN: the car sent none that may be used.

        None: no mapped message, or a frame that is damaged or repeated.
        """
        numbers = self.numbers(frame)
        if numbers is None:
            return None
        return {name: self.measurements[name].to_si(number) for name, number in numbers.items()}

    def numbers(self, frame: can.Message) -> dict[str, float] | None:
        """The same in the units of the DBC; of a switch 1 or 0."""
        known = self._frames.get((frame.arbitration_id, frame.is_extended_id))
        if known is None or frame.is_error_frame or frame.is_remote_frame:
            return None
        counts, data, counter = known.counts, bytes(frame.data), known.counter
        try:
            raws = known.message.decode_simple(data, decode_choices=False, scaling=False)
        except (cantools.Error, ValueError):
            counts.wrong_length, counts.found_bytes = counts.wrong_length + 1, len(data)
            return None
        place = known.checksum_place
        if place is not None and data[place] != known.checksum(data):
            counts.wrong_checksum += 1
            return None
        if counter is not None and counter.name in raws:
            number = int(raws[counter.name])  # type: ignore[arg-type]
            step = 1 if known.last is None else (number - known.last) % counts_to(counter)
            if step == 0:
                counts.repeated += 1
                return None
            counts.lost += step - 1
            known.last = number
        counts.accepted += 1
        return {
            field.slot.name: field.number(raw)
            for field in known.fields
            if isinstance(raw := raws.get(field.signal.name), int | float)
        }


class SignalWriter:
    """Encodes the messages that have mapped signals, one frame for each form of a message.

    A value beyond the range of its signal is sent as the nearest that the signal can have. Signals
    without a slot have the values of [messages], and otherwise the start value of the DBC.
    """

    def __init__(
        self,
        slots: Sequence[Slot],
        messages: Mapping[str, MessageMapping],
        database: Database,
        where: str,
    ) -> None:
        """Find every slot in the DBC; raises as `SignalReader` does."""
        self._frames: dict[tuple[str, int | None], _Frame] = {}
        self._counters: dict[str, int] = {}
        found = list(_located(slots, database, where))
        self._identifiers = {(of.frame_id, of.is_extended_frame) for of, _ in found}
        for message, field in found:
            every: set[int | None] = {
                each.signal.multiplexer_ids[0]
                for of, each in found
                if of is message and each.signal.multiplexer_ids
            }
            own: set[int | None] = {*(field.signal.multiplexer_ids or ())[:1]}
            for form in own or every or {None}:
                key = message.name, form
                if key not in self._frames:
                    frame = _Frame(message, messages.get(message.name, MessageMapping()))
                    _require_sendable(frame)
                    frame.raws = _first_raws(message, form)
                    self._frames[key] = frame
                self._frames[key].fields.append(field)

    def has(self, frame: can.Message) -> bool:
        """True if this sends messages with the identifier of the frame."""
        return (frame.arbitration_id, frame.is_extended_id) in self._identifiers

    def frames(
        self, values: Mapping[str, float], tick: int, is_driving: bool = True
    ) -> list[can.Message]:
        """The frames that are due in a tick; one that has a value that is not finite is left out.

        Args:
            values: in SI, by slot.
            tick: number of the control period.
            is_driving: which constants of [messages] are sent.
        """
        frames = []
        for frame in self._frames.values():
            period_s = frame.settings.period_s or (frame.message.cycle_time or 0) / 1e3
            is_due = tick % max(1, int(period_s / PERIOD_S + 1e-6)) == 0
            if is_due and all(isfinite(values[field.slot.name]) for field in frame.fields):
                frames.append(self._encode(frame, values, is_driving))
        return frames

    def _encode(self, frame: _Frame, values: Mapping[str, float], is_driving: bool) -> can.Message:
        message, settings, raws = frame.message, frame.settings, frame.raws
        for name, number in (settings.driving if is_driving else settings.standby).items():
            if name in raws:
                raws[name] = _raw(message.get_signal_by_name(name), number)
        for field in frame.fields:
            raws[field.signal.name] = field.to_raw(values[field.slot.name])
        if frame.counter is not None:
            counter = self._counters.get(message.name, -1) + 1
            counter %= counts_to(frame.counter)
            self._counters[message.name] = raws[frame.counter.name] = counter
        data = bytearray(message.encode(raws, scaling=False, strict=False))
        if frame.checksum_place is not None:
            data[frame.checksum_place] = frame.checksum(data)
        number, is_extended = message.frame_id, message.is_extended_frame
        return can.Message(0.0, number, is_extended, is_rx=False, data=data, check=True)


def _located(
    slots: Sequence[Slot], database: Database, where: str
) -> Iterator[tuple[Message, _Field]]:
    """Each slot with its place in the DBC; a slot without a dimension needs no unit there."""
    for slot in slots:
        message, signal = _find(f"{where}: {slot.name}", database, slot.column.names)
        is_plain = slot.si == "1" and slot.column.unit is None
        unit = signal.unit or ("1" if is_plain else None)
        scaling = scaling_of(where, unit, slot.column, slot.name, slot.si or None)
        yield message, _Field(slot, signal, scaling)


def _find(where: str, database: Database, names: Sequence[str]) -> Source:
    """The signal of the first of the names that the DBC has."""
    for name in names[:-1]:
        with suppress(ConfigError):
            return find_source(where, database, name)
    return find_source(where, database, names[-1])


def _require_signal(message: Message, name: str, what: str) -> Signal:
    try:
        return message.get_signal_by_name(name)
    except KeyError as error:
        names = ", ".join(signal.name for signal in message.signals)
        raise ConfigError(
            f"messages.{message.name}.{what}: expected a signal of this message ({names}), found "
            f"{name!r}. Correct the name."
        ) from error


def counts_to(counter: Signal) -> int:
    """Number of values of a counter: those of its range in the DBC, else those of its bits."""
    every = 1 << counter.length
    low, high = range_of(counter)
    return int(high) + 1 if low == 0.0 and 1.0 < high < every else every


def _checksum_place(message: Message, checksum: Checksum) -> int:
    """The byte of a message that is its checksum."""
    signal = _require_signal(message, checksum.signal, "checksum")
    begin = 0 if signal.byte_order == "little_endian" else 7
    if signal.length != 8 or signal.start % 8 != begin:
        raise ConfigError(
            f"messages.{message.name}.checksum: expected a signal that is one whole byte, found "
            f"{signal.name} at bit {signal.start} with {signal.length} bits. Leave the checksum "
            f"out; the frame is then used unchecked."
        )
    return int(signal.start) // 8


def _require_sendable(frame: _Frame) -> None:
    message, settings = frame.message, frame.settings
    for what, names in (("driving", settings.driving), ("standby", settings.standby)):
        for name in names:
            _require_signal(message, name, what)
    if settings.driving.keys() != settings.standby.keys():
        raise ConfigError(
            f"messages.{message.name}: expected the same signals in driving and standby, found "
            f"{', '.join(settings.driving) or 'none'} and {', '.join(settings.standby) or 'none'}. "
            f"Write every signal in both."
        )
    if message.is_fd or message.length > 8:
        raise ConfigError(
            f"{message.name}: expected a classic CAN frame of at most 8 bytes, found "
            f"{message.length}. Commands go out in classic frames only."
        )


def _first_raws(message: Message, form: int | None) -> dict[str, float]:
    """Raw start values of the signals of one form of a message."""
    selectors = [signal for signal in message.signals if signal.is_multiplexer]
    if len(selectors) > 1:
        raise ConfigError(
            f"{message.name}: expected at most one multiplexer, found {len(selectors)}. Nested "
            f"multiplexing is read, but not sent."
        )
    starts = {
        signal.name: float(raw) if isinstance(raw := signal.raw_initial, int | float) else 0.0
        for signal in message.signals
    }
    if not selectors:
        return starts
    selector = selectors[0].name
    form = int(starts[selector]) if form is None else form
    starts[selector] = form
    return {
        signal.name: starts[signal.name]
        for signal in message.signals
        if signal.multiplexer_ids is None or form in signal.multiplexer_ids
    }


def _raw(signal: Signal, number: float) -> float:
    """The raw value nearest to a number in the DBC's unit."""
    low, high = range_of(signal)
    raw = (min(max(number, low), high) - signal.offset) / signal.scale
    if signal.is_float:
        return float(raw)
    smallest = -(1 << signal.length - 1) if signal.is_signed else 0
    return min(max(round(raw), smallest), smallest + (1 << signal.length) - 1)


def _crc8(polynomial: int) -> Callable[[bytes], int]:
    """Start and final value 0xFF, not reflected, as in AUTOSAR's CRC library."""

    def shifted(byte: int) -> int:
        for _ in range(8):
            byte = (byte << 1) ^ (polynomial if byte & 0x80 else 0)
        return byte & 0xFF

    table = tuple(map(shifted, range(256)))
    return lambda data: reduce(lambda crc, byte: table[crc ^ byte], data, 0xFF) ^ 0xFF


_CHECKSUMS: dict[ChecksumKind, Callable[[bytes], int]] = {
    "crc8_0x1d": _crc8(0x1D),
    "crc8_0x2f": _crc8(0x2F),
    "xor8": lambda data: reduce(xor, data, 0),
    "sum8": lambda data: sum(data) & 0xFF,
}
