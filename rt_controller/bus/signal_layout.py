"""Place, scaling and range of the signals of a frame, as the DBC declares them."""

from collections.abc import Sequence
from dataclasses import dataclass

from cantools.database.can import Signal

from rt_controller.bus.dbc import misfit

_STRUCT_CODES = {8: "b", 16: "h", 32: "i"}
"""of signed integers, by bits; unsigned ones have capital letters"""
NOT_AVAILABLE = "NotAvailable"


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Scaling and valid raw values of one signal; physical = raw * scale + offset."""

    name: str
    scale: float
    offset: float
    raw_min: int
    raw_max: int
    raw_not_available: int
    unit: str

    def objection(self, raw: int) -> str | None:
        """Why this raw value may not be used; None if it may."""
        if self.raw_min <= raw <= self.raw_max:
            return None
        ends = (self.raw_min, self.raw_max, raw)
        low, high, value = (each * self.scale + self.offset for each in ends)
        is_missing = raw == self.raw_not_available  # a sender cannot send a value beyond the range
        found = "none or one beyond it" if is_missing else f"{value:g}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name}: expected a value of {low:g} to {high:g}{unit}, found {found}"


def signal_layout(message: str, signal: Signal) -> SignalLayout:
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


def struct_format(message: str, body: Sequence[Signal], first_bit: int, n_bits: int) -> str:
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
