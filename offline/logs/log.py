"""A log as it was recorded: numbers in the units of the file, with stamps and row numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import DatasetError

Array = NDArray[np.float64]


class Channel(NamedTuple):
    """One column with the time of each of its samples."""

    column: str
    t_s: Array
    """(N,)"""
    values: Array
    """(N,) in the file's unit; NaN where the file has no number"""
    row: NDArray[np.int64]
    """(N,) where a person finds the sample in the file"""
    unit: str | None
    """as the file says, or None"""


@dataclass(frozen=True, slots=True)
class Log:
    """The columns of one file that were asked for."""

    path: Path
    channels: tuple[Channel, ...]
    row_word: str
    """what a row is called in such a file: "line", "row", "frame" """
    rows: int
    """in the file"""

    def channel(self, column: str) -> Channel:
        """The channel of that column, which was asked for."""
        return next(each for each in self.channels if each.column == column)


def require_columns(path: Path, wanted: Sequence[str], available: Sequence[str]) -> None:
    """Return if all wanted columns are there.

    Raises:
        DatasetError: one is not; near matches are named.
    """
    missing = [column for column in wanted if column not in available]
    if not missing:
        return
    column = missing[0]
    lowered = {name.lower(): name for name in available}
    near = [lowered[name] for name in get_close_matches(column.lower(), lowered, n=3, cutoff=0.5)]
    hint = f"Did you mean {' or '.join(near)}? " if near else ""
    shown = ", ".join(list(available)[:40]) + (", …" if len(available) > 40 else "")
    raise DatasetError(
        f"{path}: expected a column {column!r}, found none of that name. {hint}The file has: "
        f"{shown}. Name the column in the mapping as the file does."
    )


def foreign_file(path: Path, kind: str, error: object) -> DatasetError:
    """The complaint about a file that cannot be read to its end."""
    return DatasetError(
        f"{path}: expected {kind}, found a truncated, damaged or foreign file ({error}). Export or "
        f"copy it again, or leave it out."
    )
