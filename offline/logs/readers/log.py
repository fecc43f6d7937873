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

Names = Sequence[str]
"""names that one wanted column may have, the first one first"""


class RowsOf(NamedTuple):
    """The file of a channel, and the name of a row in it, for messages."""

    path: Path
    word: str
    """"line", "row", "frame" """


class Channel(NamedTuple):
    """One column with the time of each of its samples."""

    column: str
    """as the mapping names it"""
    t_s: Array
    """(N,)"""
    values: Array
    """(N,) in the file's unit; NaN where the file has no number"""
    row: NDArray[np.int64]
    """(N,) row number of each sample, as the user counts it in the file"""
    unit: str | None
    """as written in the file, or None"""
    of: RowsOf
    file: str | None = None
    """`file` of the mapping, in a drive with one file for each signal"""

    @property
    def place(self) -> str:
        """File and column, for messages."""
        return f"{self.of.path}, column {self.column}"

    def place_of(self, sample: int) -> str:
        """File, column and row of a sample, for messages."""
        return f"{self.place}, {self.of.word} {self.row[sample]}"


@dataclass(frozen=True, slots=True)
class Log:
    """The wanted columns of one drive."""

    name: str
    path: Path
    """file, or folder of the files"""
    channels: tuple[Channel, ...]
    rows: int
    """in the longest file"""
    begin_s: float | None = 0.0
    """instant that the times count from, on the clock of the file; None: the file has no clock"""

    def channel(self, *names: str, file: str | None = None) -> Channel:
        """The channel of a wanted column with one of these names."""
        fits = [each for each in self.channels if each.file == file]
        return next(each for name in names for each in fits if each.column == name)


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
