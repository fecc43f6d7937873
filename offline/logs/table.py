"""Logs that are tables: one row an instant, whatever the file format."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offline.logs.log import Array, Channel, Log, require_columns
from offline.logs.mapping import TimeMapping
from offline.logs.units import Unit, parse_unit
from rt_controller.contract.errors import DatasetError

CLAIM_TOLERANCE = 0.01
"""share by which the usual time between rows may differ from what the mapping says"""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of equal length."""

    path: Path
    columns: Mapping[str, Array]
    """time in s where it is a date"""
    row: NDArray[np.int64]
    """(N,) where a person finds it in the file"""
    row_word: str
    units: Mapping[str, str]
    """by column, where the file says so"""


def columns_to_read(wanted: Sequence[str], time: TimeMapping) -> list[str]:
    """The wanted columns and that of time."""
    return list(dict.fromkeys([*([time.column] if time.column else []), *wanted]))


def stamp(table: Table, wanted: Sequence[str], time: TimeMapping) -> Log:
    """The table's columns as a log.

    Raises:
        DatasetError: there are no rows, time is missing or runs back, or is not what it claims.
    """
    rows = len(table.row)
    if rows < 2:
        raise DatasetError(
            f"{table.path}: expected at least two rows of numbers, found {rows}. Leave the file "
            f"out."
        )
    t_s = _time(table, time)
    channels = tuple(
        Channel(column, t_s, table.columns[column], table.row, table.units.get(column))
        for column in wanted
    )
    return Log(table.path, channels, table.row_word, rows)


def require_table_columns(
    path: Path, wanted: Sequence[str], time: TimeMapping, available: Sequence[str]
) -> list[str]:
    """The columns to read, all of which are there once.

    Raises:
        DatasetError: one is not, or time is neither a column nor a period.
    """
    if time.column is None and time.period_s is None:
        raise DatasetError(
            f"{path}: expected to be told when its rows were recorded, found neither a column nor "
            f'a period in the mapping. Write [time] with column = "…" and its unit, or with '
            f"period_s where rows come at one rate; the file has: {', '.join(available)}."
        )
    needed = columns_to_read(wanted, time)
    require_columns(path, needed, available)
    twice = [column for column in needed if list(available).count(column) > 1]
    if twice:
        raise DatasetError(
            f"{path}, column {twice[0]}: expected one column of that name, found "
            f"{list(available).count(twice[0])}. Rename them in the file."
        )
    return needed


def _time(table: Table, time: TimeMapping) -> Array:
    if time.column is None:
        period_s = time.period_s or 0.0
        return period_s * np.arange(len(table.row), dtype=np.float64)
    stamps = table.columns[time.column]
    _require_stamps(table, time.column, stamps)
    unit = Unit("s", 1.0) if time.unit == "iso8601" else parse_unit(time.unit)
    factor = unit.factor if unit else 1.0
    # Subtracting first keeps microseconds of stamps that count from 1970.
    t_s = (stamps - stamps[0]) * factor
    _require_increasing(table, time.column, stamps, t_s)
    if time.period_s is not None:
        _require_claim(table, time.column, t_s, time.period_s)
    return np.asarray(t_s, dtype=np.float64)


def _require_stamps(table: Table, column: str, stamps: Array) -> None:
    gaps = np.flatnonzero(~np.isfinite(stamps))
    if len(gaps):
        raise DatasetError(
            f"{table.path}, column {column}, {table.row_word} {table.row[gaps[0]]}: expected a "
            f"time, found none. Leave out rows without a time ({len(gaps)} of them)."
        )


def _require_increasing(table: Table, column: str, stamps: Array, t_s: Array) -> None:
    back = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(back):
        k = int(back[0]) + 1
        raise DatasetError(
            f"{table.path}, column {column}, {table.row_word} {table.row[k]}: expected time to "
            f"increase, found {stamps[k]:.10g} after {stamps[k - 1]:.10g} ({len(back)} such "
            f"places). Split the file where time starts again, or leave out repeated rows."
        )


def _require_claim(table: Table, column: str, t_s: Array, claimed_s: float) -> None:
    steps = np.diff(t_s)
    usual_s = float(np.median(steps))
    if abs(usual_s - claimed_s) <= CLAIM_TOLERANCE * claimed_s:
        return
    first = int(np.flatnonzero(np.abs(steps - claimed_s) > CLAIM_TOLERANCE * claimed_s)[0]) + 1
    raise DatasetError(
        f"{table.path}, column {column}, {table.row_word} {table.row[first]}: expected a row every "
        f"{1e3 * claimed_s:.6g} ms, as [time] period_s says, found one every {1e3 * usual_s:.6g} "
        f"ms. Correct period_s or the unit of time, or leave period_s out: the logs are brought "
        f"to the data set's period anyway."
    )
