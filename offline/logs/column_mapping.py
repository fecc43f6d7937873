"""What the mapping file says of one column of the logs."""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    FiniteFloat,
    PositiveFloat,
    field_validator,
)

from offline.logs.quantity import Quantity
from offline.logs.units import near_units, parse_unit


def _require_order(interval: tuple[float, float]) -> tuple[float, float]:
    if not interval[0] < interval[1]:
        raise ValueError(f"expected [low, high], found {list(interval)}")
    return interval


Interval = Annotated[tuple[float, float], AfterValidator(_require_order)]


class Settings(BaseModel):
    """A table of the file: no unknown field passes."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Sampling(StrEnum):
    """What a signal does between two samples of the log."""

    SAMPLED = "sampled"
    """moves on smoothly; the data set has its value at the instant"""
    MEAN = "mean"
    """moves on smoothly; the data set has its mean over the coming period"""
    HELD = "held"
    """holds the last value, as commands do; the data set has its mean over the coming period"""


class ColumnMapping(Settings):
    """A column of the logs: SI value = sign * unit(factor * number + offset), `delay_s` earlier."""

    column: str
    unit: str | None = None
    """None: as the log itself says"""
    sign: Literal[1, -1] = 1
    factor: FiniteFloat = 1.0
    offset: FiniteFloat = 0.0
    delay_s: FiniteFloat = 0.0
    """how long the log is late: what is stamped t happened at t - delay_s"""
    sampling: Sampling = Sampling.SAMPLED
    missing: Literal["refuse", "skip"] = "refuse"
    """rows without a number: an error, or no sample of this signal"""
    longest_gap_s: PositiveFloat | None = None
    """between two samples; None: that of [time]"""

    @field_validator("unit")
    @classmethod
    def _known(cls, unit: str | None) -> str | None:
        if unit is not None and parse_unit(unit) is None:
            raise ValueError(f"expected a known unit, found {unit!r}: {near_units(unit)}")
        return unit

    @field_validator("factor")
    @classmethod
    def _not_zero(cls, factor: float) -> float:
        if factor == 0.0:
            raise ValueError("expected a factor that is not zero")
        return factor


class SignalMapping(ColumnMapping):
    """A column that becomes a signal of the data set."""

    quantity: Quantity | None = None
    """what it measures; None: told by the signal's name"""
    keep: Interval | None = None
    """in SI; where it is outside, the drive is cut and left out"""
    plausible: Interval | None = None
    """in SI; a number outside is refused; None: the limits of its quantity"""
    steepest_per_s: PositiveFloat | None = None
    """in SI; where it moves faster, the drive is cut; None: the limit of its quantity"""
    may_be_constant: bool = False
