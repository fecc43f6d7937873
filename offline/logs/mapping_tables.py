"""The tables of the mapping file that are for logs only; docs/own-data.md explains every field.

Those of the signals are in `rt_controller.mapping.tables`.
"""

from typing import Annotated, Literal

from pydantic import (
    Field,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)

from offline.data.dataset import HELD_BACK
from rt_controller.mapping.tables import Clock, MappingTable, SignalMapping


class TimeMapping(Clock):
    """The clock of all columns that have none of their own, and how gaps are treated."""

    longest_gap_s: PositiveFloat | None = None
    """None: 3.5 times the usual time between two samples"""
    skip_first_s: NonNegativeFloat = 0.0


class CsvSettings(MappingTable):
    """Format of the CSV files."""

    delimiter: Annotated[str, Field(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    header_line: NonNegativeInt | None = None
    """None: the first line, without comments; 0: no header, the columns are named 1, 2, ..."""
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
    """Which checks only report, and what else there is to compare with."""

    accept_units: bool = False
    signals: dict[str, SignalMapping] = Field(default_factory=dict)
    """second measurements of the motion; no part of the data set"""
