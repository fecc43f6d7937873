"""Logs that are tables with one row for each instant: CSV, Parquet, npz and MATLAB files."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from offline.logs.mapping_tables import TimeMapping
from offline.logs.readers.log import Channel, Log, require_columns
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.units import find_unit

PERIOD_TOLERANCE = 0.01
"""share by which the usual time between rows may differ from `[time] period_s`"""


def columns_to_read(
    path: Path, wanted: Sequence[str], time: TimeMapping, available: Sequence[str]
) -> list[str]:
    """The columns to read: that of time, and the wanted ones."""
    if time.column is None and time.period_s is None:
        raise DatasetError(
            f"{path}: expected the time of each row, found neither a column nor a period in the "
            f'mapping. Write [time] with column = "…" and its unit, or with period_s if the rows '
            f"have a fixed rate; the file has: {', '.join(available)}."
        )
    needed = list(dict.fromkeys([time.column, *wanted] if time.column else wanted))
    require_columns(path, needed, available)
    for column in needed:
        if available.count(column) > 1:
            raise DatasetError(
                f"{path}, column {column}: expected one column of that name, found "
                f"{available.count(column)}. Rename them in the file."
            )
    return needed


def to_log(
    path: Path,
    frame: pd.DataFrame,
    wanted: Sequence[str],
    time: TimeMapping,
    row_word: str,
    units: Mapping[str, str],
) -> Log:
    """The wanted columns of a table with the time of each row.

    Args:
        frame: columns of numbers, time also as dates; the index is the row number in the file.
        row_word: name of a row in messages.
        units: units that the file gives, by column.
    """
    if len(frame) < 2:
        raise DatasetError(
            f"{path}: expected at least two rows of numbers, found {len(frame)}. Leave the file "
            f"out."
        )
    rows, t_s = frame.index.to_numpy(np.int64), _time(path, frame, time, row_word)
    channels = tuple(
        Channel(column, t_s, frame[column].to_numpy(np.float64), rows, units.get(column))
        for column in wanted
    )
    return Log(path, channels, row_word, len(frame))


def _time(path: Path, frame: pd.DataFrame, time: TimeMapping, row_word: str) -> Array:
    if time.column is None:
        return (time.period_s or 0.0) * np.arange(len(frame), dtype=np.float64)
    stamps = frame[time.column]
    if stamps.dtype.kind in "bu":
        stamps = stamps.astype(np.int64)

    def place(k: int) -> str:
        return f"{path}, column {time.column}, {row_word} {frame.index[k]}"

    missing = np.flatnonzero(stamps.isna() | stamps.isin([np.inf, -np.inf]))
    if len(missing):
        raise DatasetError(
            f"{place(missing[0])}: expected a time, found none. Leave out rows without a time "
            f"({len(missing)} of them)."
        )
    # Stamps that count from 1970 keep their microseconds because the first is subtracted first.
    elapsed = stamps - stamps.iloc[0]
    if pd.api.types.is_timedelta64_dtype(elapsed):
        t_s: Array = (elapsed / pd.Timedelta(seconds=1)).to_numpy(np.float64)
    else:
        unit = find_unit(time.unit)
        t_s = elapsed.to_numpy(np.float64) * (unit.factor if unit else 1.0)
    backwards = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(backwards):
        k = int(backwards[0]) + 1
        now, before = (
            str(stamp) if isinstance(stamp, pd.Timestamp) else f"{stamp:.10g}"
            for stamp in stamps.iloc[[k, k - 1]]
        )
        raise DatasetError(
            f"{place(k)}: expected time to increase, found {now} after {before} "
            f"({len(backwards)} such places). Split the file where time starts again, or leave out "
            f"repeated rows."
        )
    if time.period_s is not None:
        steps = np.diff(t_s)
        usual_s, tolerance_s = float(np.median(steps)), PERIOD_TOLERANCE * time.period_s
        if abs(usual_s - time.period_s) > tolerance_s:
            first = int(np.flatnonzero(np.abs(steps - time.period_s) > tolerance_s)[0]) + 1
            raise DatasetError(
                f"{place(first)}: expected a row every {1e3 * time.period_s:.6g} ms as in [time] "
                f"period_s, found one every {1e3 * usual_s:.6g} ms. Correct period_s or the unit "
                f"of time, or leave period_s out: the logs are converted to the data set's period "
                f"anyway."
            )
    return t_s
