"""A log as it was recorded: numbers in the units of the file, with time stamps and row numbers.

A reader takes a `Request` and returns a `Log`; `offline.logs.readers.formats` has them all.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.logs.mapping import CsvSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.names import columns_of
from rt_controller.mapping.slots import Slot
from rt_controller.mapping.tables import CanSettings, Clock, MessageMapping
from rt_controller.mapping.units import find_unit, unit_of_name

Names = Sequence[str]
"""names that one wanted column may have, the first one first"""


@dataclass(frozen=True, slots=True)
class LogColumn:
    """A column of a log with the time of each of its samples."""

    name: str
    """as the mapping has it"""
    t_s: Array
    """(N,)"""
    values: Array
    """(N,) in `unit`; NaN where the file has no number"""
    row: NDArray[np.int64]
    """(N,) row number of each sample, as the user counts it in the file"""
    unit: str
    """as written in the file; empty: the file has none"""
    path: Path
    word: str = "row"
    """name of a row of the file, for messages: "line", "row", "frame" """
    unusable: str = ""
    """number and reasons of the samples of the file that are no measurements, and left out"""
    file: str | None = None
    """`file` of the mapping, in a drive with one file for each signal"""

    @property
    def place(self) -> str:
        """File and column, for messages."""
        return f"{self.path}, column {self.name}"

    def place_of(self, sample: int) -> str:
        """File, column and row of a sample, for messages."""
        return f"{self.place}, {self.word} {self.row[sample]}"


@dataclass(frozen=True, slots=True)
class Log:
    """The wanted columns of one drive."""

    name: str
    columns: tuple[LogColumn, ...]
    rows: int
    """in the longest file"""
    begin_s: float | None = 0.0
    """instant that the times count from, on the clock of the file; None: the file has no clock"""

    def __post_init__(self) -> None:
        for each in self.columns:
            backwards = np.flatnonzero(np.diff(each.t_s) <= 0.0)
            if len(backwards):
                k = int(backwards[0]) + 1
                raise DatasetError(
                    f"{each.place_of(k)}: expected time to increase, found {each.t_s[k]:.6f} s "
                    f"after {each.t_s[k - 1]:.6f} s ({len(backwards)} such places). Split the log "
                    f"where time starts again, or choose one channel of the bus; if rows have the "
                    f'time of the row before, repeated = "skip" in [time] leaves them out.'
                )

    def column(self, *names: str, file: str | None = None) -> LogColumn:
        """The wanted column with one of these names."""
        fits = [each for each in self.columns if each.file == file]
        return next(each for name in names for each in fits if each.name == name)


class Heading(NamedTuple):
    """A wanted column of a file."""

    name: str
    """as the mapping names it"""
    text: str
    """as the file names it"""
    unit: str | None
    """behind the name in the file, or None"""


class Request(NamedTuple):
    """What is read from one file, and how."""

    path: Path
    wanted: Sequence[Names]
    clock: Clock
    csv: CsvSettings = CsvSettings()
    can: CanSettings | None = None
    slots: Sequence[Slot] = ()
    """of the wanted columns, in their order; for CAN logs"""
    messages: Mapping[str, MessageMapping] = MappingProxyType({})

    def require_columns(self) -> None:
        """Return if every signal is one column, as in all logs but those of a CAN bus."""
        for name, column, *_ in self.slots:
            if column.fine or column.negative:
                raise DatasetError(
                    f"{self.path}: expected {name} in one column, found fine or negative in the "
                    f"mapping, which name signals of a DBC and count for CAN logs only. Leave them "
                    f"out, and write one column with the number."
                )

    def choose(self, available: Sequence[str]) -> list[Heading]:
        """The wanted columns among those of a table; that of time, if there is one, first."""
        if not self.clock.column and self.clock.period_s is None:
            raise DatasetError(
                f"{self.path}: expected the time of each row, found neither a column nor a period "
                f'in the mapping. Write [time] with column = "…" and its unit, or with period_s if '
                f"the rows have a fixed rate; the file has: {', '.join(available)}."
            )
        time = [self.clock.names] if self.clock.column else []
        parts = (find_headings(self.path, names, available) for names in (time, self.wanted))
        return [heading for part in parts for heading in part]

    def to_log(
        self,
        frame: pd.DataFrame,
        columns: Sequence[Heading],
        units: Mapping[str, str] = MappingProxyType({}),
        word: str = "row",
    ) -> Log:
        """The wanted columns of a table with the time of each row.

        Args:
            frame: columns of numbers, time also as dates; the index is the row number in the file.
            columns: see `choose`.
            units: of columns, where the file has them elsewhere than in the name.
            word: name of a row.
        """
        path, clock, begin_s = self.path, self.clock, None
        if clock.column or clock.file:
            time, *columns = columns
            # Columns of different length in one table end in empty rows.
            frame = frame[frame.notna().any(axis=1)]
            place, stamps = f"{path}, column {time.name}, {word}", frame[time.text]
            missing = np.flatnonzero(stamps.isna() | stamps.isin([np.inf, -np.inf]))
            if len(missing):
                raise DatasetError(
                    f"{place} {frame.index[missing[0]]}: expected a time, found none. Leave out "
                    f"rows without a time ({len(missing)} of them)."
                )
            if clock.repeated == "skip":
                frame = frame[stamps != stamps.shift()]
        if len(frame) < 2:
            raise DatasetError(
                f"{path}: expected at least two rows of numbers, found {len(frame)}. Leave the "
                f"file out."
            )
        if clock.column or clock.file:
            t_s, begin_s = _seconds(place, frame[time.text], time, clock)
        else:
            t_s = (clock.period_s or 0.0) * np.arange(len(frame), dtype=np.float64)
        rows = frame.index.to_numpy(np.int64)
        found = []
        for each in columns:
            values = frame[each.text].to_numpy(np.float64)
            unit = units.get(each.text) or each.unit or ""
            found.append(LogColumn(each.name, t_s, values, rows, unit, path, word))
        begin_s = None if clock.starts_at_zero else begin_s
        return Log(path.name, tuple(found), len(frame), begin_s)


_BRACKETED = re.compile(r"(?P<name>.*\S)\s*[(\[{<](?P<unit>[^()\[\]{}<>]*)[)\]}>]")
_AFTER_COMMA = re.compile(r"(?P<name>.*\S),\s+(?P<unit>\S+)")
_CLEAR_ENDINGS = {
    *("kmh", "kph", "mph", "mps", "mps2", "deg", "degps", "dps", "rad", "radps", "radps2"),
    *("rpm", "bar", "ms"),
}
"""of names; single letters are too often something else"""


def _split_unit(text: str) -> Heading:
    """The name without the unit behind it; the whole text if that is no unit."""
    for pattern in (_BRACKETED, _AFTER_COMMA):
        found = pattern.fullmatch(text)
        if found and find_unit(found["unit"]):
            return Heading(found["name"], text, found["unit"])
    ending = text.lower().rpartition("_")[2]
    return Heading(text, text, unit_of_name(text.lower()) if ending in _CLEAR_ENDINGS else None)


def find_headings(path: Path, wanted: Sequence[Names], texts: Sequence[str]) -> list[Heading]:
    """The wanted columns among those of a file; their names may have a unit behind them.

    Raises:
        DatasetError: the file has none, or several, of a wanted name.
    """
    known, found = [_split_unit(text) for text in texts], []
    for names in wanted:
        fits = (
            (name, [e for e in known if name == e.text] or [e for e in known if name == e.name])
            for name in names
        )
        name, own = next((each for each in fits if each[1]), ("", []))
        if len(own) > 1:
            raise DatasetError(
                f"{path}, column {name}: expected one column of that name, found {len(own)}. "
                f"Rename them in the file."
            )
        if not own:
            raise DatasetError(
                f"{path}: expected a column {' or '.join(map(repr, names))}, found none of that "
                f"name. {columns_of('file', names[0], texts)} Name the column in the mapping as "
                f"the file does."
            )
        found += [heading._replace(name=name) for heading in own]
    return list(dict.fromkeys(found))


PERIOD_TOLERANCE = 0.01
"""share by which the usual time between rows may differ from `period_s` of the clock"""


def _seconds(place: str, stamps: pd.Series, column: Heading, clock: Clock) -> tuple[Array, float]:
    """Time (T,) of the rows since the first, and the time of that.

    Stamps that count from 1970 keep their microseconds because the first is subtracted first.
    """
    if stamps.dtype.kind in "bu":
        stamps = stamps.astype(np.int64)
    first: Any = stamps.iloc[0]
    elapsed = stamps - first
    if isinstance(first, pd.Timestamp | pd.Timedelta):
        t_s = (elapsed / pd.Timedelta(seconds=1)).to_numpy(np.float64)
        begin_s = float(
            first.timestamp() if isinstance(first, pd.Timestamp) else first.total_seconds()
        )
    else:
        own, given = find_unit(column.unit or ""), find_unit(clock.unit or column.unit or "s")
        if given is None or (column.unit and own != given):
            raise DatasetError(
                f"{place} {stamps.index[0]}: expected a time in {clock.unit}, as the mapping says, "
                f"found {column.text!r}. Correct the unit in [time], or leave it out."
            )
        t_s = given.factor * elapsed.to_numpy(np.float64)
        begin_s = given.factor * float(first)
    steps = np.diff(t_s)
    usual_s, period_s = float(np.median(steps)), clock.period_s
    if period_s is not None and abs(usual_s - period_s) > PERIOD_TOLERANCE * period_s:
        k = int(np.argmax(np.abs(steps - period_s) > PERIOD_TOLERANCE * period_s)) + 1
        raise DatasetError(
            f"{place} {stamps.index[k]}: expected a row every {1e3 * period_s:.6g} ms as "
            f"in [time] period_s, found one every {1e3 * usual_s:.6g} ms. Correct period_s or the "
            f"unit of time, or leave period_s out: the logs are converted to the data set's period "
            f"anyway."
        )
    return t_s, begin_s
