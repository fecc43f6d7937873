"""The tables of the mapping file that are for logs only; docs/own-data.md explains every field.

Those of the signals are in `rt_controller.mapping.tables`.
"""

from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)

from offline.data.dataset import HELD_BACK
from rt_controller.mapping.tables import MappingTable
from rt_controller.mapping.units import find_unit


def _of_time(unit: str) -> str:
    found = find_unit(unit)
    if unit != "iso8601" and (found is None or found.si != "s"):
        raise ValueError("expected a unit of time or 'iso8601'")
    return unit


class TimeMapping(MappingTable):
    """When the rows of a table were recorded. MF4 files and CAN logs have time stamps already."""

    column: str | None = None
    unit: Annotated[str, AfterValidator(_of_time)] = "s"
    """"iso8601" for dates"""
    period_s: PositiveFloat | None = None
    """time between two rows; compared with the column if there is one"""
    longest_gap_s: PositiveFloat | None = None
    """None: 3.5 times the usual time between two samples"""
    skip_first_s: NonNegativeFloat = 0.0


class CsvSettings(MappingTable):
    """Format of the CSV files."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    header_line: PositiveInt = 1
    units_line: PositiveInt | None = None
    encoding: str = "utf-8-sig"


class SplitSettings(MappingTable):
    """Which drives are held back. Files with a pattern here come first, the rest is drawn."""

    by: Literal["episode", "file"] = "episode"
    seed: NonNegativeInt = 0
    share: Annotated[float, Field(gt=0.0, lt=0.5)] = HELD_BACK
    """of the drawn ones: this share for validation, and the same for the test"""
    validation: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    longest_episode_s: PositiveFloat | None = None


class RolesSettings(MappingTable):
    """See `offline.data.signals.Roles`, and `LogMapping.resolve_roles` for what None stands for."""

    centred: tuple[str, ...] | None = None
    odd: tuple[str, ...] | None = None
    past: tuple[str, ...] | None = None


class ChecksSettings(MappingTable):
    """Which checks only report."""

    accept_units: bool = False
