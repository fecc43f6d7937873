"""From frames of a car's own messages to SI values of the mapped signals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan

import can
import cantools
from cantools.database.can import Database, Message, Signal

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.car_signals import Checksum, MessageMapping
from rt_controller.mapping.checksum import checksum_of
from rt_controller.mapping.dbc_signals import Source, find_source
from rt_controller.mapping.scaling import Scaling, scaling_of
from rt_controller.mapping.slots import Slot

_MISSING_WORDS = ("notavailable", "sna", "invalid", "error")
"""names of raw values, without blanks and underscores, that stand for no value"""


@dataclass(slots=True)
class ReadCounts:
    """Frames of one message since the start."""

    accepted: int = 0
    wrong_length: int = 0
    """or not decodable; dropped"""
    wrong_checksum: int = 0
    """dropped"""
    repeated: int = 0
    """same counter as the frame before; dropped"""
    lost: int = 0
    """missing between two counters"""


@dataclass(frozen=True, slots=True)
class _Field:
    """One slot in one message."""

    slot: str
    signal: str
    scaling: Scaling
    lowest: float
    highest: float
    """of the number in the DBC's unit"""
    missing: frozenset[int]
    """raw values that stand for no value"""
    plausible: tuple[float, float]
    on: frozenset[int] | None

    def convert(self, raw: float, number: float) -> float:
        """The SI value; NaN if the car sent none, or one that cannot be."""
        if raw in self.missing or not self.lowest <= number <= self.highest:
            return nan
        if self.on is not None:
            return float(raw in self.on)
        value = self.scaling.factor * number + self.scaling.offset
        low, high = self.plausible
        return value if low <= value <= high else nan


class _Incoming:
    __slots__ = ("checksum", "checksum_place", "counter", "counts", "fields", "last", "message")

    def __init__(self, message: Message, settings: MessageMapping | None) -> None:
        self.message = message
        self.fields: list[_Field] = []
        self.counts = ReadCounts()
        self.counter: Signal | None = None
        self.checksum: Checksum | None = None
        self.checksum_place = 0
        self.last: int | None = None
        if settings is not None:
            if settings.counter is not None:
                self.counter = require_signal(message, settings.counter, "counter")
            if settings.checksum is not None:
                self.checksum = settings.checksum
                self.checksum_place = checksum_place(message, settings.checksum)


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
        self._incoming: dict[tuple[int, bool], _Incoming] = {}
        for slot in slots:
            source = find_source(f"{where}: {slot.name}", database, slot.column.column)
            message, signal = self.sources[slot.name] = source
            key = message.frame_id, message.is_extended_frame
            if key not in self._incoming:
                self._incoming[key] = _Incoming(message, messages.get(message.name))
            own = dimensionless_if_none(signal, slot)
            scaling = scaling_of(where, own, slot.column, slot.name, slot.si)
            self._incoming[key].fields.append(_field(slot, signal, scaling))
        self.counts = {each.message.name: each.counts for each in self._incoming.values()}

    def read(self, frame: can.Message) -> dict[str, float] | None:
        """SI values of the slots in a frame, by name; NaN: the car sent none that may be used.

        None: no mapped message, or a frame that is damaged or repeated.
        """
        incoming = self._incoming.get((frame.arbitration_id, frame.is_extended_id))
        if incoming is None or frame.is_error_frame or frame.is_remote_frame:
            return None
        counts, checksum, data = incoming.counts, incoming.checksum, bytes(frame.data)
        try:
            raws = incoming.message.decode_simple(data, decode_choices=False, scaling=False)
        except (cantools.Error, ValueError):
            counts.wrong_length += 1
            return None
        if checksum is not None:
            place = incoming.checksum_place
            if data[place] != checksum_of(checksum, data, place):
                counts.wrong_checksum += 1
                return None
        if incoming.counter is not None and incoming.counter.name in raws:
            counter = int(raws[incoming.counter.name])  # type: ignore[arg-type]
            step = 1 if incoming.last is None else counter - incoming.last
            step %= 1 << incoming.counter.length
            if step == 0:
                counts.repeated += 1
                return None
            counts.lost += step - 1
            incoming.last = counter
        counts.accepted += 1
        return {
            field.slot: field.convert(raw, number_of(incoming.message, field.signal, raw))
            for field in incoming.fields
            if isinstance(raw := raws.get(field.signal), int | float)
        }


def dimensionless_if_none(signal: Signal, slot: Slot) -> str | None:
    """The unit that the DBC gives; "1" of a slot without a dimension if there is none."""
    return signal.unit or ("1" if slot.si == "1" and slot.column.unit is None else None)


def number_of(message: Message, signal: str, raw: float) -> float:
    """The number of a raw value in the DBC's unit."""
    found = message.get_signal_by_name(signal)
    return float(raw * found.scale + found.offset)


def require_signal(message: Message, name: str, what: str) -> Signal:
    """The signal of a message.

    Raises:
        ConfigError: the message has none of that name.
    """
    try:
        return message.get_signal_by_name(name)
    except KeyError as error:
        names = ", ".join(signal.name for signal in message.signals)
        raise ConfigError(
            f"messages.{message.name}.{what}: expected a signal of this message ({names}), found "
            f"{name!r}. Correct the name."
        ) from error


def checksum_place(message: Message, checksum: Checksum) -> int:
    """The byte of a message that is its checksum.

    Raises:
        ConfigError: the signal is not one whole byte.
    """
    signal = require_signal(message, checksum.signal, "checksum")
    begin = 0 if signal.byte_order == "little_endian" else 7
    if signal.length != 8 or signal.start % 8 != begin:
        raise ConfigError(
            f"messages.{message.name}.checksum: expected a signal that is one whole byte, found "
            f"{signal.name} at bit {signal.start} with {signal.length} bits. Leave the checksum "
            f"out; the frame is then used unchecked."
        )
    return int(signal.start) // 8


def _field(slot: Slot, signal: Signal, scaling: Scaling) -> _Field:
    low, high = signal.minimum, signal.maximum
    if low is None or high is None or not low < high:
        low, high = float("-inf"), float("inf")
    half_lsb = 0.5 * abs(signal.scale)
    missing = (
        int(raw)
        for raw, text in (signal.choices or {}).items()
        if any(
            word in str(text).lower().replace("_", "").replace(" ", "") for word in _MISSING_WORDS
        )
    )
    return _Field(
        slot.name,
        signal.name,
        scaling,
        low - half_lsb,
        high + half_lsb,
        frozenset(missing),
        slot.plausible,
        slot.on,
    )
