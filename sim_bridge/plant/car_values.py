"""Types of the numbers in a car file: `{ value, source }` with the limits of the value."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field


def value_with_source(entry: Any) -> Any:
    """The value of an entry `{ value, source }` of a car file."""
    if not isinstance(entry, dict) or set(entry) != {"value", "source"}:
        raise ValueError("expected { value, source }")
    if not isinstance(entry["source"], str) or not entry["source"].strip():
        raise ValueError("expected a source in words")
    return entry["value"]


_IsNumber = Field(strict=True, allow_inf_nan=False)
_PositiveShare = Annotated[float, Field(strict=True, gt=0, le=1)]
_Ratio = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
_HasSource = BeforeValidator(value_with_source)

Number = Annotated[float, _IsNumber, _HasSource]
NonNegative = Annotated[float, _IsNumber, Field(ge=0), _HasSource]
Positive = Annotated[float, _IsNumber, Field(gt=0), _HasSource]
Share = Annotated[float, _IsNumber, Field(ge=0, le=1), _HasSource]
STEEPEST_RAD = 0.7
"""slopes beyond are not roads; the equations hold for small angles of the car against the road"""
Slope = Annotated[float, _IsNumber, Field(ge=-STEEPEST_RAD, le=STEEPEST_RAD), _HasSource]
PositiveShare = Annotated[_PositiveShare, _HasSource]
_PerGear = Field(min_length=6, max_length=6)
Ratios = Annotated[tuple[_Ratio, ...], _PerGear, _HasSource]
Efficiencies = Annotated[tuple[_PositiveShare, ...], _PerGear, _HasSource]

N_MAP_SPEEDS = 8
N_MAP_PEDALS = 8
_Speeds = Field(min_length=N_MAP_SPEEDS, max_length=N_MAP_SPEEDS)
_Pedals = Field(min_length=N_MAP_PEDALS, max_length=N_MAP_PEDALS)
_Finite = Annotated[float, _IsNumber]
MapSpeeds = Annotated[tuple[Annotated[_Finite, Field(ge=0)], ...], _Speeds, _HasSource]
MapPedals = Annotated[tuple[Annotated[_Finite, Field(ge=0, le=1)], ...], _Pedals, _HasSource]
MapTorques = Annotated[tuple[Annotated[tuple[_Finite, ...], _Speeds], ...], _Pedals, _HasSource]
"""one row for each pedal position, one column for each speed"""
