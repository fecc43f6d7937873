"""What a raw value of a CAN signal is: a measurement, or one that the car marks as none.

Import, `rt-controller signals check` and gateway decide it here, so that a gap in one of them is a
gap in all.
"""

from collections import Counter
from collections.abc import Sequence
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
    """The raw values of one slot, and what they mean.

    Its number is that of `signal`, plus that of `fine`, and negative if `negative` is set. There is
    no measurement if one of them is none.
    """

    def __init__(
        self,
        slot: Slot,
        signal: Signal,
        scaling: Scaling,
        fine: Signal | None = None,
        negative: Signal | None = None,
    ) -> None:
        self.slot, self.signal, self.scaling = slot, signal, scaling
        self.fine, self.negative = fine, negative
        self.summands = (signal, fine) if fine else (signal,)
        self.parts = (*self.summands, negative) if negative else self.summands
        self.samples = 0
        self.unusable: Counter[str] = Counter()
        """numbers of samples that are none, by why"""
        limits = limits_of(slot.quantity, scaling.si)
        self.plausible = slot.plausible or (limits.low, limits.high)
        """in SI"""
        self._ranges = tuple(map(range_of, self.parts)) if slot.plausible is None else ()
        self._missing = tuple(map(missing_values, self.parts))
        on, off = slot.on, slot.off
        if on is None and isinstance(slot.column, SwitchMapping) and _is_number_of_state(signal):
            on, off = frozenset({1}), frozenset({0})
        if on is not None and off is None:
            off = frozenset({0, 1, *(signal.choices or ())} - self._missing[0].keys()) - on
        if on is not None and not off:
            raise ConfigError(
                f"{slot.name}: expected a raw value of {signal.name} that means off, found none: "
                f"all are in on or stand for no value. Write off = [...]."
            )
        self.on, self.off = on, off
        """raw values that mean 0; None: no switch, or one in SI"""

    def number(self, *raws: float) -> float:
        """Of the raw values of `parts`, in the unit of the DBC; NaN: no measurement.

        A switch has 1 or 0.
        """
        self.samples += 1
        if self.on is not None and raws[0] in self.on:
            return 1.0
        numbers = [
            float(raw * part.scale + part.offset)
            for raw, part in zip(raws, self.parts, strict=True)
        ]
        number = 0.0 if self.on is not None else sum(numbers[: len(self.summands)])
        if self.negative is not None and raws[-1] != 0:
            number = -number
        reason = self._objection(raws, numbers, number)
        if not reason:
            return number
        self.unusable[reason] += 1
        return nan

    def _objection(self, raws: Sequence[float], numbers: Sequence[float], number: float) -> str:
        """Why this is no measurement; empty: it is one."""
        if self.off is not None and raws[0] in self.off:
            return ""
        for raw, missing in zip(raws, self._missing, strict=True):
            if raw in missing:
                return f"{missing[int(raw)]!r} in the DBC"
        if self.off is not None:
            return f"{raws[0]:g} raw, which is neither in on nor in off"
        if not isfinite(number):
            return "not finite"
        for part, (low, high), each in zip(self.parts, self._ranges, numbers, strict=False):
            half_lsb = 0.5 * abs(part.scale)
            if not low - half_lsb <= each <= high + half_lsb:
                return f"outside of [{low:g}, {high:g}], the range of the DBC"
        low, high = self.plausible
        return "" if low <= self.to_si(number) <= high else self.implausible

    def explain(self) -> str:
        """Why samples were none, the most frequent reason first, and what to do."""
        name = self.slot.name
        reasons = "; ".join(f"{n} {reason}" for reason, n in self.unusable.most_common(3))
        remedy = "the car has no value then; if it has, correct the DBC"
        is_beyond_dbc = any("range of" in each for each in self.unusable)
        if self.unusable[self.implausible] or is_beyond_dbc:
            remedy = f"check unit, factor and offset, or write plausible for {name}"
        for part, hint in ((part, placeholder(part)) for part in self.summands):
            if not hint or not is_beyond_dbc:
                continue
            low, high = range_of(part)
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

    @property
    def sendable(self) -> tuple[float, float]:
        """The smallest and the largest number that range and bits of the DBC allow, in its unit."""
        low, high = map(sum, zip(*map(allowed_range, self.summands), strict=True))
        return (low if self.negative is None else -high), high

    def to_si(self, number: float) -> float:
        """The SI value of what `number` returns."""
        if self.on is not None:
            return number
        return self.scaling.factor * number + self.scaling.offset

    def from_si(self, value: float) -> float:
        """The number in the unit of the DBC for an SI value."""
        return (value - self.scaling.offset) / self.scaling.factor


def missing_values(signal: Signal) -> dict[int, str]:
    """The raw values of a signal that stand for no value, and their names."""
    names = {int(raw): str(text) for raw, text in (signal.choices or {}).items()}
    return {raw: text for raw, text in names.items() if stands_for_no_value(text)}


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


def allowed_range(signal: Signal) -> tuple[float, float]:
    """What both the range in the DBC and the bits of a signal allow, in its unit."""
    (low, high), (lowest, highest) = range_of(signal), bits_range(signal)
    return max(low, lowest), min(high, highest)


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
