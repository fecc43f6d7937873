"""Reading a log: CSV, numpy or Parquet, to columns of numbers."""

import csv
import gzip
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.contract.files import open_regular

_ENDINGS = ".csv, .csv.gz, .npz or .parquet"
_SEPARATORS = ",;\t"


class LogFile(NamedTuple):
    """A log whose content is known, but not yet what it means."""

    path: Path
    titles: tuple[str, ...]
    columns: tuple[Array, ...]
    """(n,) each, in the order of `titles`; NaN where the log has no number"""

    def column(self, title: str) -> Array:
        """(n,) the column with this title."""
        return self.columns[self.titles.index(title)]


def read_log(path: Path) -> LogFile:
    """All columns of numbers of a log.

    Raises:
        ConfigError: the file cannot be read, or has an unknown format.
        MissingExtraError: a Parquet file, and the extra `logs` is not installed.
    """
    name = path.name.lower()
    try:
        open_regular(path).close()  # a pipe is not waited for
        if name.endswith((".csv", ".csv.gz")):
            return _read_csv(path)
        if name.endswith(".npz"):
            with np.load(path, allow_pickle=False) as arrays:
                return _log(path, [(title, arrays[title]) for title in arrays.files])
        if name.endswith((".parquet", ".pq")):
            with needs_extra("logs", f"reading {path}"):
                from pyarrow import parquet
            table = parquet.read_table(path)
            return _log(
                path, [(t, c.to_numpy()) for t, c in zip(table.column_names, table, strict=True)]
            )
    except (OSError, EOFError, BadZipFile, ValueError, csv.Error) as error:
        raise ConfigError(
            f"{path}: expected a log that can be read, found an error: {error}."
        ) from error
    raise ConfigError(
        f"--recording {path}: expected a log that ends in {_ENDINGS}. Convert other formats first."
    )


def _read_csv(path: Path) -> LogFile:
    """A table with a header, separated by commas, semicolons or tabs."""
    opened = gzip.open if path.name.lower().endswith(".gz") else open
    with opened(path, "rt", encoding="utf-8-sig", newline="") as file:
        header = file.readline()
        separator = max(_SEPARATORS, key=header.count)
        (titles,) = csv.reader([header], delimiter=separator)
        rows = [row for row in csv.reader(file, delimiter=separator) if row]
    short = next((k for k, row in enumerate(rows) if len(row) != len(titles)), None)
    if short is not None:
        raise ValueError(
            f"row {short + 2} has {len(rows[short])} cells and the header has {len(titles)}"
        )
    cells = zip(*rows, strict=True) if rows else [()] * len(titles)
    columns = [np.array([_number(cell) for cell in column], float64) for column in cells]
    return LogFile(path, tuple(title.strip() for title in titles), tuple(columns))


def _number(cell: str) -> float:
    """The number of a cell; NaN for an empty cell or a text."""
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _log(path: Path, named: Iterable[tuple[str, np.ndarray]]) -> LogFile:
    """The one-dimensional arrays of numbers; others are left out.

    Raises:
        ValueError: they differ in length.
    """
    kept = [
        (title, array.astype(float64))
        for title, array in named
        if array.ndim == 1 and array.dtype.kind in "fiub"
    ]
    lengths = {len(array) for _, array in kept}
    if len(lengths) > 1:
        listed = ", ".join(f"{title} {len(array)}" for title, array in kept)
        raise ValueError(f"columns of different lengths: {listed}")
    return LogFile(path, tuple(t for t, _ in kept), tuple(array for _, array in kept))
