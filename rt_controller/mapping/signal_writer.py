"""From SI values to frames of a car's own messages: commands, or what a simulated car sends."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from math import floor, isfinite, tau

import can
from cantools.database.can import Database, Message, Signal

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.car_signals import MessageMapping
from rt_controller.mapping.checksum import checksum_of
from rt_controller.mapping.dbc_signals import find_source
from rt_controller.mapping.scaling import Scaling, scaling_of
from rt_controller.mapping.signal_reader import (
    checksum_place,
    dimensionless_if_none,
    require_signal,
)
from rt_controller.mapping.slots import Slot

PERIODIC = ("pose.yaw",)
"""slots with an angle that a car may send in 0 to 360 deg, or in ±180 deg"""


@dataclass(slots=True)
class _Outgoing:
    """One frame: a message, or one of its multiplexed forms."""

    message: Message
    settings: MessageMapping
    period_ticks: int
    raws: dict[str, float]
    """of every signal of the frame, raw"""
    slots: list[tuple[str, Signal, Scaling]] = field(default_factory=list)


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
        """Find every slot in the DBC.

        Raises:
            ConfigError: a column is not in the DBC, or [messages] names a signal that is not.
            DatasetError: a unit is missing or does not fit.
        """
        self._outgoing: dict[tuple[str, int | None], _Outgoing] = {}
        self._counters: dict[str, int] = {}
        self._on = {slot.name: slot.on for slot in slots if slot.on is not None}
        found = [
            (slot, *find_source(f"{where}: {slot.name}", database, slot.column.column))
            for slot in slots
        ]
        for slot, message, signal in found:
            own_unit = dimensionless_if_none(signal, slot)
            scaling = scaling_of(where, own_unit, slot.column, slot.name, slot.si)
            forms = {
                other.multiplexer_ids[0]
                for _, of, other in found
                if of is message and other.multiplexer_ids
            }
            every: set[int | None] = {*forms} if forms else {None}
            own = {*signal.multiplexer_ids[:1]} if signal.multiplexer_ids else every
            for form in own:
                self._frame(message, form, messages).slots.append((slot.name, signal, scaling))

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
        for outgoing in self._outgoing.values():
            if tick % outgoing.period_ticks:
                continue
            if all(isfinite(values[name]) for name, _, _ in outgoing.slots):
                frames.append(self._encode(outgoing, values, is_driving))
        return frames

    def _encode(
        self, outgoing: _Outgoing, values: Mapping[str, float], is_driving: bool
    ) -> can.Message:
        message, settings, raws = outgoing.message, outgoing.settings, outgoing.raws
        constants = settings.driving if is_driving else settings.standby
        for name, number in constants.items():
            if name in raws:
                raws[name] = _raw(message.get_signal_by_name(name), number)
        for name, signal, scaling in outgoing.slots:
            if name in self._on:
                raws[signal.name] = _switched(self._on[name], values[name] > 0.5)
                continue
            number = (values[name] - scaling.offset) / scaling.factor
            if name in PERIODIC:
                number = _turned(signal, number, abs(tau / scaling.factor))
            raws[signal.name] = _raw(signal, number)
        if settings.counter is not None:
            modulus = 1 << message.get_signal_by_name(settings.counter).length
            counter = (self._counters.get(message.name, -1) + 1) % modulus
            self._counters[message.name] = raws[settings.counter] = counter
        data = bytearray(message.encode(raws, scaling=False, strict=False))
        if settings.checksum is not None:
            place = checksum_place(message, settings.checksum)
            data[place] = checksum_of(settings.checksum, data, place)
        return can.Message(
            arbitration_id=message.frame_id,
            is_extended_id=message.is_extended_frame,
            is_rx=False,
            data=data,
            check=True,
        )

    def _frame(
        self, message: Message, form: int | None, messages: Mapping[str, MessageMapping]
    ) -> _Outgoing:
        key = message.name, form
        if key not in self._outgoing:
            settings = messages.get(message.name, MessageMapping())
            _require_known(message, settings)
            period_s = settings.period_s or (message.cycle_time or 0) / 1e3
            ticks = max(1, round(period_s / PERIOD_S))
            self._outgoing[key] = _Outgoing(message, settings, ticks, _first_raws(message, form))
        return self._outgoing[key]


def _require_known(message: Message, settings: MessageMapping) -> None:
    for what, names in (("driving", settings.driving), ("standby", settings.standby)):
        for name in names:
            require_signal(message, name, what)
    if settings.driving.keys() != settings.standby.keys():
        raise ConfigError(
            f"messages.{message.name}: expected the same signals in driving and standby, found "
            f"{', '.join(settings.driving) or 'none'} and {', '.join(settings.standby) or 'none'}. "
            f"Write every signal in both."
        )
    if settings.counter is not None:
        require_signal(message, settings.counter, "counter")
    if settings.checksum is not None:
        checksum_place(message, settings.checksum)
    if message.is_fd or message.length > 8:
        raise ConfigError(
            f"{message.name}: expected a classic CAN frame of at most 8 bytes, found "
            f"{message.length}. Commands go out in classic frames only."
        )


def _first_raws(message: Message, form: int | None) -> dict[str, float]:
    """Raw start values of the signals of one form of a message."""
    raws: dict[str, float] = {}
    selectors = [signal for signal in message.signals if signal.is_multiplexer]
    if len(selectors) > 1:
        raise ConfigError(
            f"{message.name}: expected at most one multiplexer, found {len(selectors)}. Nested "
            f"multiplexing is read, but not sent."
        )
    if selectors and form is None:
        form = int(_start(selectors[0]))
    for signal in message.signals:
        if signal.is_multiplexer:
            raws[signal.name] = form or 0
        elif signal.multiplexer_ids is None or form in signal.multiplexer_ids:
            raws[signal.name] = _start(signal)
    return raws


def _start(signal: Signal) -> float:
    raw = signal.raw_initial
    return float(raw) if isinstance(raw, int | float) else 0.0


def _switched(on: frozenset[int], is_on: bool) -> int:
    """The smallest raw value that means this."""
    return min(on) if is_on else next(raw for raw in count() if raw not in on)


def _turned(signal: Signal, number: float, turn: float) -> float:
    """An angle in the DBC's unit, moved by whole turns into the range of its signal."""
    low = signal.minimum
    if low is None or (signal.maximum is not None and low <= number <= signal.maximum):
        return number
    return number - turn * floor((number - float(low)) / turn)


def _raw(signal: Signal, number: float) -> float:
    """The raw value nearest to a number in the DBC's unit."""
    low, high = signal.minimum, signal.maximum
    if low is not None and high is not None and low < high:
        number = min(max(number, float(low)), float(high))
    raw = (number - signal.offset) / signal.scale
    if signal.is_float:
        return float(raw)
    smallest = -(1 << signal.length - 1) if signal.is_signed else 0
    largest = smallest + (1 << signal.length) - 1
    return min(max(round(raw), smallest), largest)
