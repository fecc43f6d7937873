"""A log as it was recorded: numbers in the units of the file, with time stamps and row numbers.

The functions that read one raise the errors of `offline.logs.readers.source.read_log`.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.names import columns_of
from rt_controller.mapping.tables import TEXT_TIMES, Clock, Sampling
from rt_controller.mapping.units import find_unit, unit_of_name

Names = Sequence[str]
"""names that one wanted column may have, the first one first; empty last: it may be missing"""


class RowsOf(NamedTuple):
    """The file of a column, and the name of a row in it, for messages."""

    path: Path
    word: str
    """"line", "row", "frame" """


@dataclass(frozen=True, slots=True)
class Series:
    """A column of a log with the time of each of its samples; `to_drive` makes signals of it."""

    column: str
    """as the mapping names it"""
    t_s: Array
    """(N,); of a signal increasing, time of measurement, delays subtracted"""
    values: Array
    """(N,) in `unit`; NaN where the file has no number; of a signal finite and in SI"""
    row: NDArray[np.int64]
    """(N,) row number of each sample, as the user counts it in the file"""
    unit: str
    """as written in the file; empty: the file has none"""
    of: RowsOf
    file: str | None = None
    """`file` of the mapping, in a drive with one file for each signal"""
    name: str = ""
    """of the signal"""
    sampling: Sampling = Sampling.SAMPLED
    connected: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(N-1,) of a signal: whether it is known between a sample and the next"""
    jumps: int = 0
    """how often it changed faster than possible"""
    gaps: tuple[int, ...] = ()
    """samples whose next one is too far away to bridge"""

    @property
    def place(self) -> str:
        """File and column, for messages."""
        return f"{self.of.path}, column {self.column}"

    def place_of(self, sample: int) -> str:
        """File, column and row of a sample, for messages."""
        return f"{self.place}, {self.of.word} {self.row[sample]}"

    @property
    def usual_step_s(self) -> float:
        """Median time between two samples."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def missing_s(self) -> float:
        """Sum of all gaps."""
        return float(np.diff(self.t_s)[list(self.gaps)].sum())


@dataclass(frozen=True, slots=True)
class Log:
    """The wanted columns of one drive."""

    name: str
    path: Path
    """file, or folder of the files"""
    channels: tuple[Series, ...]
    rows: int
    """in the longest file"""
    begin_s: float | None = 0.0
    """instant that the times count from, on the clock of the file; None: the file has no clock"""

    def channel(self, *names: str, file: str | None = None) -> Series:
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


_BRACKETED = re.compile(r"(?P<name>.*\S)\s*[(\[{<](?P<unit>[^()\[\]{}<>]*)[)\]}>]")
_AFTER_COMMA = re.compile(r"(?P<name>.*\S),\s+(?P<unit>\S+)")
_CLEAR_ENDINGS = {
    *("kmh", "kph", "mph", "mps", "mps2", "deg", "degps", "dps", "rad", "radps", "radps2"),
    *("rpm", "bar", "ms"),
}
"""of names; single letters are too often something else"""


class Heading(NamedTuple):
    """A wanted column of a file."""

    name: str
    """as the mapping names it"""
    text: str
    """as the file names it"""
    unit: str | None
    """behind the name in the file, or None"""


def find_headings(path: Path, wanted: Sequence[Names], texts: Sequence[str]) -> list[Heading]:
    """The wanted columns among those of a file; their names may have a unit behind them.

    Raises:
        DatasetError: the file has none, or several, of a wanted name.
    """
    known = [split_unit(text) for text in texts]
    found = (_find(path, names, texts, known) for names in wanted)
    return list(dict.fromkeys(heading for heading in found if heading is not None))


def split_unit(text: str) -> Heading:
    """The name without the unit behind it; the whole text if that is no unit."""
    for pattern in (_BRACKETED, _AFTER_COMMA):
        found = pattern.fullmatch(text)
        if found and find_unit(found["unit"]):
            return Heading(found["name"], text, found["unit"])
    ending = text.lower().rpartition("_")[2]
    return Heading(text, text, unit_of_name(text.lower()) if ending in _CLEAR_ENDINGS else None)


def _find(
    path: Path, names: Names, texts: Sequence[str], known: Sequence[Heading]
) -> Heading | None:
    for name in filter(None, names):
        fits = [each for each in known if name == each.text] or [
            each for each in known if name == each.name
        ]
        if len(fits) == 1:
            return fits[0]._replace(name=name)
        if fits:
            raise DatasetError(
                f"{path}, column {name}: expected one column of that name, found {len(fits)}. "
                f"Rename them in the file."
            )
    if "" in names:
        return None
    others = f" or {' or '.join(map(repr, names[1:]))}" if names[1:] else ""
    raise DatasetError(
        f"{path}: expected a column {names[0]!r}{others}, found none of that name. "
        f"{columns_of('file', names[0], texts)} Name the column in the mapping as the file does."
    )


PERIOD_TOLERANCE = 0.01
"""share by which the usual time between rows may differ from `period_s` of the clock"""


class Columns(NamedTuple):
    """The columns of a table that are read."""

    time: Heading | None
    values: list[Heading]

    @property
    def texts(self) -> list[str]:
        """Names of all columns to read, as the file has them."""
        every = ([self.time] if self.time else []) + self.values
        return list(dict.fromkeys(each.text for each in every))

    def text_time(self, text: str, time: Clock) -> str | None:
        """How times are written in the column, if it is that of time and has text."""
        is_time = self.time is not None and text == self.time.text
        return time.unit if is_time and time.unit in TEXT_TIMES else None


def columns_to_read(
    path: Path, wanted: Sequence[Names], time: Clock, available: Sequence[str]
) -> Columns:
    """The columns to read: that of time, and the wanted ones."""
    if not time.column and time.period_s is None:
        raise DatasetError(
            f"{path}: expected the time of each row, found neither a column nor a period in the "
            f'mapping. Write [time] with column = "…" and its unit, or with period_s if the rows '
            f"have a fixed rate; the file has: {', '.join(available)}."
        )
    stamps = find_headings(path, [time.names], available) if time.column else [None]
    return Columns(stamps[0], find_headings(path, wanted, available))


def to_log(
    of: RowsOf,
    frame: pd.DataFrame,
    columns: Columns,
    time: Clock,
    unit_of: Callable[[str], str | None] = lambda text: None,
) -> Log:
    """The wanted columns of a table with the time of each row.

    Args:
        of: the file.
        frame: columns of numbers, time also as dates; the index is the row number in the file.
        columns: those to read.
        time: clock of the rows.
        unit_of: gives the unit of a column that the file has elsewhere than in the column's name.
    """
    if len(frame) < 2:
        raise DatasetError(
            f"{of.path}: expected at least two rows of numbers, found {len(frame)}. Leave the "
            f"file out."
        )
    if columns.time is None:
        t_s = (time.period_s or 0.0) * np.arange(len(frame), dtype=np.float64)
        begin_s = None
    else:
        # Columns of different length in one table end in empty rows.
        frame = frame[frame[columns.texts].notna().any(axis=1)]
        frame = frame.loc[_known_times(of, frame, columns.time, time)]
        t_s, first_s = _seconds(of, frame, columns.time, time)
        begin_s = None if time.starts_at_zero else first_s
    rows = frame.index.to_numpy(np.int64)
    channels = tuple(
        Series(
            each.name,
            t_s,
            frame[each.text].to_numpy(np.float64),
            rows,
            unit_of(each.text) or each.unit or "",
            of,
        )
        for each in columns.values
    )
    return Log(of.path.name, of.path, channels, len(frame), begin_s)


def _known_times(of: RowsOf, frame: pd.DataFrame, column: Heading, clock: Clock) -> pd.Index:
    """Numbers of the rows whose time is used; `DatasetError` if one has none."""
    stamps = frame[column.text]
    missing = np.flatnonzero(stamps.isna() | stamps.isin([np.inf, -np.inf]))
    if len(missing):
        raise DatasetError(
            f"{of.path}, column {column.name}, {of.word} {frame.index[missing[0]]}: expected a "
            f"time, found none. Leave out rows without a time ({len(missing)} of them)."
        )
    is_new = stamps != stamps.shift()
    return frame.index[is_new] if clock.repeated == "skip" else frame.index


def _seconds(of: RowsOf, frame: pd.DataFrame, column: Heading, clock: Clock) -> tuple[Array, float]:
    """Time (T,) of the rows since the first, and the time of that.

    Stamps that count from 1970 keep their microseconds because the first is subtracted first.
    """
    stamps, place = frame[column.text], f"{of.path}, column {column.name}"
    if stamps.dtype.kind in "bu":
        stamps = stamps.astype(np.int64)
    first: Any = stamps.iloc[0]
    elapsed = stamps - first
    if isinstance(first, pd.Timestamp | pd.Timedelta):
        t_s = (elapsed / pd.Timedelta(seconds=1)).to_numpy(np.float64)
        is_date = isinstance(first, pd.Timestamp)
        begin_s = float(first.timestamp() if is_date else first.total_seconds())
    else:
        factor = _factor(place, column, clock)
        t_s, begin_s = factor * elapsed.to_numpy(np.float64), factor * float(first)
    _require_increase(f"{place}, {of.word}", t_s, stamps)
    if clock.period_s is not None:
        _require_period(f"{place}, {of.word}", t_s, stamps, clock.period_s)
    return t_s, begin_s


def _factor(place: str, column: Heading, clock: Clock) -> float:
    """Seconds in the unit of time of a column of numbers."""
    own, given = find_unit(column.unit or ""), find_unit(clock.unit or column.unit or "s")
    if given is None or (column.unit and own != given):
        raise DatasetError(
            f"{place}: expected a time in {clock.unit}, as the mapping says, found "
            f"{column.text!r}. Correct the unit in [time], or leave it out."
        )
    return given.factor


def _require_increase(place: str, t_s: Array, stamps: pd.Series) -> None:
    backwards = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(backwards):
        k = int(backwards[0]) + 1
        now, before = (
            str(stamp) if isinstance(stamp, pd.Timestamp | pd.Timedelta) else f"{stamp:.10g}"
            for stamp in stamps.iloc[[k, k - 1]]
        )
        raise DatasetError(
            f"{place} {stamps.index[k]}: expected time to increase, found {now} after {before} "
            f"({len(backwards)} such places). Split the file where time starts again; if rows have "
            f'the time of the row before, repeated = "skip" in [time] leaves them out.'
        )


def _require_period(place: str, t_s: Array, stamps: pd.Series, period_s: float) -> None:
    steps = np.diff(t_s)
    usual_s, tolerance_s = float(np.median(steps)), PERIOD_TOLERANCE * period_s
    if abs(usual_s - period_s) > tolerance_s:
        first = int(np.flatnonzero(np.abs(steps - period_s) > tolerance_s)[0]) + 1
        raise DatasetError(
            f"{place} {stamps.index[first]}: expected a row every {1e3 * period_s:.6g} ms as in "
            f"[time] period_s, found one every {1e3 * usual_s:.6g} ms. Correct period_s or the "
            f"unit of time, or leave period_s out: the logs are converted to the data set's period "
            f"anyway."
        )
