"""From a column of a log to a signal in SI, checked sample by sample."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offline.logs.column_mapping import ColumnMapping, Sampling, SignalMapping
from offline.logs.log import Array, Channel, Log
from offline.logs.mapping import Mapping
from offline.logs.quantity import limits_of
from offline.logs.units import Unit, near_units, parse_unit, unit_of_name
from rt_controller.contract.errors import DatasetError

LONGEST_GAP_PERIODS = 3.5
"""between two samples, in the usual time between two: two lost ones are bridged"""
SHORTEST_STEP_S = 0.02
"""over which steepness is judged, so that the noise of fast samples is not taken for a jump"""


@dataclass(frozen=True, slots=True)
class Series:
    """A signal of one log, in SI, as finely sampled as it was recorded."""

    name: str
    unit: str
    column: str
    t_s: Array
    """(N,) increasing; when it happened"""
    values: Array
    """(N,) finite"""
    row: NDArray[np.int64]
    """(N,) in the file"""
    sampling: Sampling
    bridged: NDArray[np.bool_]
    """(N-1,) whether the signal is known between a sample and the next"""
    jumps: int
    """how often it moved faster than it can"""
    gaps: tuple[int, ...] = ()
    """samples after which the next one is too far away to know what was in between"""

    @property
    def usual_step_s(self) -> float:
        return float(np.median(np.diff(self.t_s)))


@dataclass(frozen=True, slots=True)
class Drive:
    """What one log says of all signals, and of the poses where they are asked for."""

    path: Path
    row_word: str
    rows: int
    signals: tuple[Series, ...]
    """in the order of `Mapping.signals`"""
    poses: tuple[Series, ...]
    """X, Y, yaw without turns left out; or none"""

    @property
    def all_series(self) -> tuple[Series, ...]:
        return (*self.signals, *self.poses)

    def series(self, name: str) -> Series:
        """The series of that name, which is there."""
        return next(series for series in self.all_series if series.name == name)


POSE_UNITS = {"x": "m", "y": "m", "yaw": "rad"}
POSE_STEEPEST_PER_S = (120.0, 120.0, 5.0)


def to_drive(log: Log, mapping: Mapping) -> Drive:
    """The signals of a log.

    Raises:
        DatasetError: a number is missing or impossible, time runs back, or units do not fit.
    """
    begin_s = min((channel.t_s[0] for channel in log.channels if len(channel.t_s)), default=0.0)
    first_s = begin_s + mapping.time.skip_first_s
    default_gap_s = mapping.time.longest_gap_s
    signals = tuple(
        _to_series(log, name, unit_of_name(name), column, first_s, default_gap_s)
        for name, column in mapping.signals.items()
    )
    poses = tuple(
        _to_series(log, name, unit, column, first_s, default_gap_s)
        for (name, unit), column in zip(POSE_UNITS.items(), mapping.pose_columns, strict=False)
    )
    if poses:
        x, y, yaw = poses
        yaw = replace(yaw, values=np.unwrap(yaw.values))
        poses = tuple(
            _without_jumps(series, steepest)
            for series, steepest in zip((x, y, yaw), POSE_STEEPEST_PER_S, strict=True)
        )
    signals = tuple(
        _within_limits(log, mapping, series, column)
        for series, column in zip(signals, mapping.signals.values(), strict=True)
    )
    return Drive(log.path, log.row_word, log.rows, signals, poses)


def _to_series(
    log: Log,
    name: str,
    si: str | None,
    column: ColumnMapping,
    first_s: float,
    default_gap_s: float | None,
) -> Series:
    channel = log.channel(column.column)
    unit = _unit(log, channel, column, name, si)
    is_known = np.isfinite(channel.values)
    if column.missing == "refuse" and not np.all(is_known):
        missing = np.flatnonzero(~is_known)
        found = "none" if np.isnan(channel.values[missing[0]]) else "an infinite one"
        raise DatasetError(
            f"{_place(log, channel, int(missing[0]))}: expected a number, found {found} "
            f"({len(missing)} of {len(is_known)} samples). Export the column without holes, or "
            f'write missing = "skip" for {name} where other columns are faster than it.'
        )
    kept = is_known & (channel.t_s >= first_s)
    if np.count_nonzero(kept) < 2:
        raise DatasetError(
            f"{log.path}, column {column.column}: expected at least two samples, found "
            f"{np.count_nonzero(kept)}. Leave the file out."
        )
    _require_increasing(log, channel)
    t_s = channel.t_s[kept]
    values = column.sign * (unit.factor * (column.factor * channel.values[kept] + column.offset))
    values = values + column.sign * unit.offset
    steps = np.diff(t_s)
    longest_s = column.longest_gap_s or default_gap_s or LONGEST_GAP_PERIODS * np.median(steps)
    return Series(
        name,
        unit.si,
        column.column,
        t_s - column.delay_s,
        values,
        channel.row[kept],
        column.sampling,
        steps <= longest_s,
        jumps=0,
        gaps=tuple(np.flatnonzero(steps > longest_s).tolist()),
    )


def _within_limits(log: Log, mapping: Mapping, series: Series, column: SignalMapping) -> Series:
    """The series, cut where it leaves what is to be kept or moves faster than it can."""
    limits = limits_of(mapping.quantity(series.name), series.unit)
    low, high = column.plausible or (limits.low, limits.high)
    beyond = np.flatnonzero((series.values < low) | (series.values > high))
    if len(beyond):
        k = int(beyond[0])
        raise DatasetError(
            f"{log.path}, column {series.column}, {log.row_word} {series.row[k]}: expected "
            f"{series.name} between {low:g} and {high:g} {series.unit}, found "
            f"{series.values[k]:.6g} ({len(beyond)} of {len(series.values)} samples). Is the unit "
            f"of the log the one of the mapping? Else correct the log, or write plausible = "
            f"[low, high] for {series.name}."
        )
    series = _without_jumps(series, column.steepest_per_s or limits.steepest_per_s)
    if column.keep is None:
        return series
    is_kept = (series.values >= column.keep[0]) & (series.values <= column.keep[1])
    return replace(series, bridged=series.bridged & is_kept[:-1] & is_kept[1:])


def _without_jumps(series: Series, steepest_per_s: float) -> Series:
    """The series, cut where it moves faster than that."""
    steps = np.maximum(np.diff(series.t_s), SHORTEST_STEP_S)
    jumps = series.bridged & (np.abs(np.diff(series.values)) > steepest_per_s * steps)
    return replace(series, bridged=series.bridged & ~jumps, jumps=int(np.count_nonzero(jumps)))


def _unit(log: Log, channel: Channel, column: ColumnMapping, name: str, si: str | None) -> Unit:
    of_file = parse_unit(channel.unit) if channel.unit is not None else None
    of_mapping = parse_unit(column.unit) if column.unit is not None else None
    where = f"{log.path}, column {channel.column}"
    if of_mapping and of_file and of_mapping != of_file:
        raise DatasetError(
            f"{where}: expected numbers in {column.unit}, as the mapping says of {name}, found a "
            f"file that says {channel.unit}. Correct the unit in the mapping, or convert that "
            f"file; all logs of one import share their units."
        )
    unit = of_mapping or of_file
    if unit is None:
        found = f"{channel.unit!r}" if channel.unit else "no unit in the file"
        raise DatasetError(
            f"{where}: expected a unit, found {found} and none in the mapping. Write unit for "
            f"{name}; {near_units(channel.unit or '')}."
        )
    if si and unit.si != si:
        raise DatasetError(
            f"{where}: expected a unit that becomes {si}, as the name {name} says, found "
            f"{channel.unit or column.unit}, which becomes {unit.si}. Name another column, or "
            f"write the unit in the mapping."
        )
    return unit


def _require_increasing(log: Log, channel: Channel) -> None:
    back = np.flatnonzero(np.diff(channel.t_s) <= 0.0)
    if len(back):
        k = int(back[0]) + 1
        raise DatasetError(
            f"{_place(log, channel, k)}: expected time to increase, found {channel.t_s[k]:.10g} s "
            f"after {channel.t_s[k - 1]:.10g} s. Split the log where time starts again, or choose "
            f"one channel of the bus."
        )


def _place(log: Log, channel: Channel, k: int) -> str:
    return f"{log.path}, column {channel.column}, {log.row_word} {channel.row[k]}"
