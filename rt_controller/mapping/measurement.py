"""What a raw value of a CAN signal is: a measurement, or one that the car marks as none.

Import, `rt-controller signals check` and gateway decide it here, so that a gap in one of them is a
gap in all.
"""

from collections import Counter
from math import inf, isfinite, nan

from cantools.database.can import Signal

from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.quantity import limits_of
from rt_controller.mapping.slots import Scaling, Slot
from rt_controller.mapping.tables import SwitchMapping
from rt_controller.mapping.value_names import stands_for_no_value

ALLOWED_UNUSABLE_SHARE = 0.01
"""share of samples that may be no measurements"""


class Measurement:
    """The raw values of one slot, and what they mean."""

    def __init__(self, slot: Slot, signal: Signal, scaling: Scaling) -> None:
        self.slot, self.signal, self.scaling = slot, signal, scaling
        self.samples = 0
        self.unusable: Counter[str] = Counter()
        """numbers of samples that are none, by why"""
        limits = limits_of(slot.quantity, scaling.si)
        self.plausible = slot.plausible or (limits.low, limits.high)
        """in SI"""
        self._low, self._high = range_of(signal) if slot.plausible is None else (-inf, inf)
        self._half_lsb = 0.5 * abs(signal.scale)
        names = {int(raw): str(text) for raw, text in (signal.choices or {}).items()}
        self._missing = {raw: text for raw, text in names.items() if stands_for_no_value(text)}
        on, off = slot.on, slot.off
        if on is None and isinstance(slot.column, SwitchMapping) and _is_number_of_state(signal):
            on, off = frozenset({1}), frozenset({0})
        if on is not None and off is None:
            off = frozenset({0, 1, *names} - self._missing.keys()) - on
        if on is not None and not off:
            raise ConfigError(
                f"{slot.name}: expected a raw value of {signal.name} that means off, found none: "
                f"all are in on or stand for no value. Write off = [...]."
            )
        self.on, self.off = on, off
        """raw values that mean 0; None: no switch, or one in SI"""

    def number(self, raw: float) -> float:
        """In the unit of the DBC; NaN: no measurement. A switch has 1 or 0."""
        self.samples += 1
        if self.on is not None and raw in self.on:
            return 1.0
        number = 0.0
        if self.on is None:
            number = float(raw * self.signal.scale + self.signal.offset)
        reason = self._objection(raw, number)
        if not reason:
            return number
        self.unusable[reason] += 1
        return nan

    def _objection(self, raw: float, number: float) -> str:
        """Why this is no measurement; empty: it is one."""
        if self.off is not None and raw in self.off:
            return ""
        if raw in self._missing:
            return f"{self._missing[int(raw)]!r} in the DBC"
        if self.off is not None:
            return f"{raw:g} raw, which is neither in on nor in off"
        if not isfinite(number):
            return "not finite"
        if not self._low - self._half_lsb <= number <= self._high + self._half_lsb:
            return f"outside of [{self._low:g}, {self._high:g}], the range of the DBC"
        low, high = self.plausible
        return "" if low <= self.to_si(number) <= high else self.implausible

    def explain(self) -> str:
        """Why samples were none, the most frequent reason first, and what to do."""
        name = self.slot.name
        reasons = "; ".join(f"{n} {reason}" for reason, n in self.unusable.most_common(3))
        remedy = "the car has no value then; if it has, correct the DBC"
        if self.unusable[self.implausible] or any("range of" in each for each in self.unusable):
            remedy = f"check unit, factor and offset, or write plausible for {name}"
        if hint := placeholder(self.signal):
            low, high = range_of(self.signal)
            remedy = (
                f"the range [{low:g}, {high:g}] of the DBC is a placeholder ({hint}): write "
                f"plausible for {name}, which replaces it, or correct the DBC"
            )
        if self.off is not None:
            remedy = f"list the raw values in on and off of {name}"
        return f"{reasons}: {remedy}"

    @property
    def implausible(self) -> str:
        """The reason of a number that is not plausible: unit, sign or signal may be wrong."""
        low, high = self.plausible
        return f"outside of [{low:g}, {high:g}] {self.scaling.si}, the plausible range"

    def to_si(self, number: float) -> float:
        """The SI value of what `number` returns."""
        if self.on is not None:
            return number
        return self.scaling.factor * number + self.scaling.offset

    def from_si(self, value: float) -> float:
        """The number in the unit of the DBC for an SI value."""
        return (value - self.scaling.offset) / self.scaling.factor


def _is_number_of_state(signal: Signal) -> bool:
    """True for a number without a unit that counts states, such as 0 to 3 in two bits."""
    is_plain = signal.scale == 1 and signal.offset == 0 and not signal.is_float
    return is_plain and not signal.is_signed and not signal.unit


def range_of(signal: Signal) -> tuple[float, float]:
    """The range of a signal in the DBC, in its unit; infinite if it has none."""
    low, high = signal.minimum, signal.maximum
    if low is None or high is None or not low < high:
        return -inf, inf
    return float(low), float(high)


def bits_range(signal: Signal) -> tuple[float, float]:
    """The smallest and the largest number that the bits of a signal can carry, in its unit."""
    if signal.is_float:
        return -inf, inf
    smallest = -(1 << signal.length - 1) if signal.is_signed else 0
    ends = (smallest, smallest + (1 << signal.length) - 1)
    low, high = sorted(float(raw * signal.scale + signal.offset) for raw in ends)
    return low, high


def placeholder(signal: Signal) -> str:
    """Why the range in the DBC is probably no range of the quantity; empty: it may be one."""
    (low, high), (lowest, highest) = range_of(signal), bits_range(signal)
    if not isfinite(low) or signal.is_float:
        return ""
    if signal.is_signed and low >= 0.0 and lowest < 0.0 and high > highest:
        return "the signal is signed, and this is the range of an unsigned one"
    if (low, high) == (0.0, 1.0) and highest - lowest > 1.5:
        return "[0, 1] is written where no range is known"
    if high < lowest or low > highest:
        return f"its bits carry {lowest:g} to {highest:g}"
    return ""
