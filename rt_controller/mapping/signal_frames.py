"""Frames of a car's own messages: from and to SI values of the mapped signals."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import floor, isfinite, tau

import can
import cantools
from cantools.database.can import Database, Message, Signal

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.car_file import Source, find_source
from rt_controller.mapping.checksum import Place, checksum_of, place_of
from rt_controller.mapping.measurement import (
    ALLOWED_UNUSABLE_SHARE,
    Measurement,
    allowed_range,
    range_of,
)
from rt_controller.mapping.slots import Slot, scaling_of
from rt_controller.mapping.tables import MessageMapping
from rt_controller.mapping.units import find_unit

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
    sources: tuple[int, ...] = ()
    """addresses that send a message with source = "any"; only frames of the first are read"""


class _Field(Measurement):
    """One slot in one message."""

    def to_raws(self, value: float) -> dict[str, float]:
        """The raw values that are sent for an SI value, by signal."""
        if self.on is not None:  # the smallest raw value that means this
            return {self.signal.name: min(self.on if value > 0.5 else self.off or {0})}
        number = self.from_si(value)
        low, high = self.sendable
        if self.slot.name == PERIODIC and isfinite(low) and not low <= number <= high:
            turn = abs(tau / self.scaling.factor)
            number -= turn * floor((number - low) / turn)
        raws: dict[str, float] = {}
        if self.negative is not None:
            raws[self.negative.name] = float(number < 0.0)
            number = abs(number)
        if self.fine is None:
            return {**raws, self.signal.name: _raw(self.signal, number)}
        raw = raws[self.signal.name] = _raw(self.signal, number - _middle(self.fine, self.signal))
        rest = number - float(raw * self.signal.scale + self.signal.offset)
        return {**raws, self.fine.name: _raw(self.fine, rest)}


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
        self.place: Place | None = None
        """of the checksum"""
        where, checksum, source = f"messages.{message.name}", settings.checksum, settings.source
        if settings.counter is not None:
            self.counter = _require_signal(f"{where}.counter", message, settings.counter)
        if checksum is not None:
            signal = _require_signal(f"{where}.checksum", message, checksum.signal)
            self.place = place_of(f"{where}.checksum", checksum, signal)
        self.identifier = int(message.frame_id)
        if source is None:
            return
        if not message.is_extended_frame:
            raise ConfigError(
                f"{where}.source: expected a message with a 29-bit identifier, whose lowest 8 bits "
                f"are the source address, found the 11-bit identifier {self.identifier:#x}. Leave "
                f"source out."
            )
        if source != "any":
            self.identifier = self.identifier & ~0xFF | source

    @property
    def key(self) -> tuple[int, bool | None]:
        """Of the frames that are read: identifier and whether it has 29 bits.

        If the source does not count, the bits above it and None.
        """
        if self.settings.source == "any":
            return self.identifier >> 8, None
        return self.identifier, self.message.is_extended_frame

    def checksum(self, identifier: int, data: bytes | bytearray, counter: int) -> int:
        """That a frame must have; 0 if the message has none."""
        settings, place = self.settings.checksum, self.place
        if settings is None or place is None:
            return 0
        return checksum_of(settings, place, identifier, data, counter)


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
        self._frames: dict[tuple[int, bool | None], _Frame] = {}
        for message, field in _located(slots, database, where):
            self.sources[field.slot.name] = Source(message, field.signal)
            self.measurements[field.slot.name] = field
            frame = _Frame(message, messages.get(message.name, MessageMapping()))
            frame = self._frames.setdefault(frame.key, frame)
            if frame.message is not message:
                raise ConfigError(
                    f"{where}: expected one message for the identifier {frame.identifier:#x}, "
                    f"found {frame.message.name} and {message.name}. Correct source in [messages]."
                )
            frame.fields.append(field)
        self.counts = {each.message.name: each.counts for each in self._frames.values()}

    def has(self, frame: can.Message) -> bool:
        """True if a slot is in messages with this identifier."""
        return self._known(frame) is not None

    def _known(self, frame: can.Message) -> _Frame | None:
        number, is_extended = frame.arbitration_id, frame.is_extended_id
        known = self._frames.get((number, is_extended))
        return self._frames.get((number >> 8, None)) if known is None and is_extended else known

    def objection(self, name: str) -> tuple[str, str]:
        """Why the frames of a slot cannot be used, and what to do; empty: they can.

        Also if there are none.
        """
        message = self.sources[name].message
        counts, measured = self.counts[message.name], self.measurements[name]
        if counts.wrong_checksum > counts.accepted:
            return (
                f"{counts.wrong_checksum} frames of {message.name} with a wrong checksum",
                f"Correct [messages.{message.name}] checksum: kind, signal, parameters",
            )
        if len(counts.sources) > 1:
            listed = ", ".join(f"{address:#04x}" for address in sorted(counts.sources))
            return (
                f"frames of {message.name} from {len(counts.sources)} source addresses ({listed})",
                f"Name the one that is read: [messages.{message.name}] source = 0x…",
            )
        if counts.wrong_length > ALLOWED_UNUSABLE_SHARE * counts.accepted:
            return (
                f"{counts.wrong_length} frames of {message.name} have {counts.found_bytes} bytes, "
                f"the DBC says {message.length}",
                "Use the DBC of this car, or correct the length of the message in it",
            )
        if measured.samples:
            return "", ""
        known = next(each for each in self._frames.values() if each.message is message)
        kind = "29-bit" if message.is_extended_frame else "11-bit"
        problem = f"no sample: no frame of {message.name} ({kind} id {known.identifier:#x})"
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
        known, identifier = self._known(frame), frame.arbitration_id
        if known is None or frame.is_error_frame or frame.is_remote_frame:
            return None
        counts, data, counter = known.counts, bytes(frame.data), known.counter
        try:
            raws = known.message.decode_simple(data, decode_choices=False, scaling=False)
        except (cantools.Error, ValueError):
            counts.wrong_length, counts.found_bytes = counts.wrong_length + 1, len(data)
            return None
        counted = None if counter is None else raws.get(counter.name)
        number = counted if isinstance(counted, int) else 0
        if known.place and known.place.read(data) != known.checksum(identifier, data, number):
            counts.wrong_checksum += 1
            return None
        if known.settings.source == "any":
            address = identifier & 0xFF
            if address not in counts.sources:
                counts.sources += (address,)
            if address != counts.sources[0]:
                return None
        if counter is not None and counted is not None:
            last = number - 1 if known.last is None else known.last
            step = (number - last) % counts_to(counter)
            if step == 0:
                counts.repeated += 1
                return None
            counts.lost += step - 1
            known.last = number
        counts.accepted += 1
        numbers = {}
        for field in known.fields:
            found = (raws.get(part.name) for part in field.parts)
            values = [raw for raw in found if isinstance(raw, int | float)]
            if len(values) == len(field.parts):
                numbers[field.slot.name] = field.number(*values)
        return numbers


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
        sent = self._frames.values()
        self._identifiers = {(each.identifier, each.message.is_extended_frame) for each in sent}

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
            raws |= field.to_raws(values[field.slot.name])
        counter, number = 0, frame.identifier
        if frame.counter is not None:
            counter = (self._counters.get(message.name, -1) + 1) % counts_to(frame.counter)
            self._counters[message.name] = raws[frame.counter.name] = counter
        data = bytearray(message.encode(raws, scaling=False, strict=False))
        if frame.place is not None:
            frame.place.write(data, frame.checksum(number, data, counter))
        return can.Message(
            arbitration_id=number,
            is_extended_id=message.is_extended_frame,
            is_fd=message.is_fd,
            is_rx=False,
            data=data,
            check=True,
        )


def _located(
    slots: Sequence[Slot], database: Database, where: str
) -> Iterator[tuple[Message, _Field]]:
    """Each slot with its place in the DBC; a slot without a dimension needs no unit there."""
    for slot in slots:
        message, signal = _find(f"{where}: {slot.name}", database, slot.column.names)
        is_plain = slot.si == "1" and slot.column.unit is None
        unit = signal.unit or ("1" if is_plain else None)
        scaling = scaling_of(where, unit, slot.column, slot.name, slot.si or None)
        fine, negative = (
            _part(f"{where}: {slot.name}.{what}", message, signal, getattr(slot.column, what))
            for what in ("fine", "negative")
        )
        of_fine = find_unit(fine.unit) if fine is not None and fine.unit else None
        if of_fine and fine and unit and find_unit(unit) not in (None, of_fine):
            raise ConfigError(
                f"{where}: {slot.name}.fine: expected a number in {unit} as that of {signal.name}, "
                f"found {fine.unit}. Name another signal, or correct the unit in the DBC."
            )
        yield message, _Field(slot, signal, scaling, fine, negative)


def _find(where: str, database: Database, names: Sequence[str]) -> Source:
    """The signal of the first of the names that the DBC has."""
    for name in names[:-1]:
        with suppress(ConfigError):
            return find_source(where, database, name)
    return find_source(where, database, names[-1])


def _part(where: str, message: Message, of: Signal, name: str | None) -> Signal | None:
    """The signal `name`, which is in every frame that has the signal `of`."""
    if name is None:
        return None
    part = _require_signal(where, message, name.removeprefix(f"{message.name}."))
    if part.multiplexer_ids not in (None, of.multiplexer_ids):
        raise ConfigError(
            f"{where}: expected {name} in the frames that have {of.name}, found other values of "
            f"the multiplexer. Name a signal of the same frames."
        )
    return part


def _require_signal(where: str, message: Message, name: str) -> Signal:
    try:
        return message.get_signal_by_name(name)
    except KeyError as error:
        names = ", ".join(signal.name for signal in message.signals)
        raise ConfigError(
            f"{where}: expected a signal of {message.name} ({names}), found {name!r}. Correct the "
            f"name."
        ) from error


def counts_to(counter: Signal) -> int:
    """Number of values of a counter: those of its range in the DBC, else those of its bits."""
    every = 1 << counter.length
    low, high = range_of(counter)
    return int(high) + 1 if low == 0.0 and 1.0 < high < every else every


def _require_sendable(frame: _Frame) -> None:
    message, settings = frame.message, frame.settings
    for what, names in (("driving", settings.driving), ("standby", settings.standby)):
        for name in names:
            _require_signal(f"messages.{message.name}.{what}", message, name)
    if settings.driving.keys() != settings.standby.keys():
        raise ConfigError(
            f"messages.{message.name}: expected the same signals in driving and standby, found "
            f"{', '.join(settings.driving) or 'none'} and {', '.join(settings.standby) or 'none'}. "
            f"Write every signal in both."
        )
    if message.length > 8 and not message.is_fd:
        raise ConfigError(
            f"{message.name}: expected a classic CAN frame of at most 8 bytes, found "
            f"{message.length}. Give a message of CAN FD the VFrameFormat of CAN FD in the DBC."
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


def _middle(fine: Signal, coarse: Signal) -> float:
    """The number that a fine part is at most half a step of the coarse one away from.

    0, or what is nearest to it in the range of the fine part.
    """
    (low, high), half_step = allowed_range(fine), 0.5 * abs(coarse.scale)
    if high - low < 2.0 * half_step:
        return 0.5 * (low + high)
    return min(max(0.0, low + half_step), high - half_step)


def _raw(signal: Signal, number: float) -> float:
    """The raw value nearest to a number in the DBC's unit."""
    low, high = range_of(signal)
    raw = (min(max(number, low), high) - signal.offset) / signal.scale
    if signal.is_float:
        return float(raw)
    smallest = -(1 << signal.length - 1) if signal.is_signed else 0
    return min(max(round(raw), smallest), smallest + (1 << signal.length) - 1)
