"""A log as it was recorded: numbers in the units of the file, with time stamps and row numbers.

The functions that read one raise the errors of `offline.logs.readers.source.read_log`.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.names import columns_of


class Channel(NamedTuple):
    """One column with the time of each of its samples."""

    column: str
    t_s: Array
    """(N,)"""
    values: Array
    """(N,) in the file's unit; NaN where the file has no number"""
    row: NDArray[np.int64]
    """(N,) row number of each sample, as the user counts it in the file"""
    unit: str | None
    """as written in the file, or None"""


@dataclass(frozen=True, slots=True)
class Log:
    """The requested columns of one file."""

    path: Path
    channels: tuple[Channel, ...]
    row_word: str
    """name of a row in such a file: "line", "row", "frame" """
    rows: int
    """in the file"""

    def channel(self, column: str) -> Channel:
        """The channel of a requested column."""
        return next(each for each in self.channels if each.column == column)


def require_columns(path: Path, wanted: Sequence[str], available: Sequence[str]) -> None:
    """Raise a `DatasetError` that lists similar names if the file lacks a wanted column."""
    column = next((column for column in wanted if column not in available), None)
    if column is None:
        return
    raise DatasetError(
        f"{path}: expected a column {column!r}, found none of that name. "
        f"{columns_of('file', column, available)} Name the column in the mapping as the file does."
    )


@contextmanager
def readable(
    path: Path, kind: str, failures: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Context in which a file is read: these exceptions of its reader become a `DatasetError`."""
    try:
        yield
    except DatasetError:
        raise
    except failures as error:
        raise DatasetError(
            f"{path}: expected {kind}, found a truncated, damaged or foreign file "
            f"({str(error) or type(error).__name__}). Export or copy it again, or leave it out."
        ) from error
