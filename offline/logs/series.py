"""The signals of a drive in SI: from columns of a log, checked sample by sample, to one period."""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.logs.mapping import LogMapping
from offline.logs.readers.log import Log, Series
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.quantity import limits_of
from rt_controller.mapping.slots import scaling_of
from rt_controller.mapping.tables import (
    LONGEST_GAP_PERIODS,
    ColumnMapping,
    Sampling,
    SignalMapping,
    is_angle,
)
from rt_controller.mapping.units import si_unit_of_name

SHORTEST_STEP_S = 0.02
"""time over which a change is judged, so that noise of fast samples does not count as a jump"""
POSE_SIGNALS = (("x", "m", 120.0), ("y", "m", 120.0), ("yaw", "rad", 5.0))
"""name, SI unit and largest rate of change per second"""
_WGS84_A_M, _WGS84_E2 = 6378137.0, 6.69437999014e-3
"""semi-major axis and square of the eccentricity of the ellipsoid"""
AVERAGED_FROM = 2.0
"""samples per period from which a signal is averaged instead of interpolated"""
_SLACK = 1e-6
"""of a period, so that rounding of time stamps loses no sample"""


class LoggedDrive(NamedTuple):
    """All signals of one log, and its poses if the mapping has [pose]."""

    name: str
    rows: int
    """in its longest file"""
    signals: tuple[Series, ...]
    """in the order of `LogMapping.read_signals`"""
    poses: tuple[Series, ...] = ()
    """x, y, and yaw continuous over full turns; or none"""

    @property
    def all_series(self) -> tuple[Series, ...]:
        """Signals and poses."""
        return (*self.signals, *self.poses)


class Stretch(NamedTuple):
    """A time interval without gap."""

    begin_s: float
    end_s: float


def to_drive(log: Log, mapping: LogMapping) -> LoggedDrive:
    """The signals of a log.

    Raises:
        DatasetError: a number is missing or impossible, time runs backwards, or units do not fit.
    """
    begin_s = min((channel.t_s[0] for channel in log.channels if len(channel.t_s)), default=0.0)
    signals = tuple(
        _within_limits(mapping, _to_series(log, mapping, begin_s, name, column), column)
        for name, column in mapping.read_signals.items()
    )
    poses: list[tuple[Series, float]] = []
    for (name, unit, steepest), pose in zip(POSE_SIGNALS, mapping.pose_columns, strict=False):
        series = _to_series(log, mapping, begin_s, name, pose, "rad" if is_angle(pose) else unit)
        if series.unit == "rad":
            series = replace(series, values=np.unwrap(series.values))
        poses.append((series, steepest))
    if mapping.pose is not None and mapping.pose.is_geographic:
        (east, _), (north, _) = poses[:2]
        for i, series in enumerate(_on_plane(east, north)):
            poses[i] = series, poses[i][1]
    found = tuple(_without_jumps(series, steepest) for series, steepest in poses)
    return LoggedDrive(log.name, log.rows, signals, found)


def _on_plane(longitude: Series, latitude: Series) -> tuple[Series, Series]:
    """East and north in m, on the tangent plane of the WGS 84 ellipsoid at the first point.

    With the radii of curvature of the meridian and of the prime vertical there.
    """
    outside = np.flatnonzero(np.abs(latitude.values) > 0.5 * np.pi)
    if len(outside):
        raise DatasetError(
            f"{latitude.place_of(int(outside[0]))}: expected a latitude within 90 deg, found "
            f"{np.degrees(latitude.values[outside[0]]):.6g}. Write the longitude as x and the "
            f"latitude as y, both in deg."
        )
    first = float(latitude.values[0])
    flat = 1.0 - _WGS84_E2 * np.sin(first) ** 2
    north_m = _WGS84_A_M * (1.0 - _WGS84_E2) / flat**1.5
    east_m = _WGS84_A_M / flat**0.5 * np.cos(first)
    return (
        replace(longitude, unit="m", values=east_m * (longitude.values - longitude.values[0])),
        replace(latitude, unit="m", values=north_m * (latitude.values - first)),
    )


def _to_series(
    log: Log,
    mapping: LogMapping,
    begin_s: float,
    name: str,
    column: ColumnMapping,
    unit: str | None = None,
) -> Series:
    channel = log.channel(*column.names, file=column.file)
    scaling = scaling_of(
        channel.place, channel.unit or None, column, name, unit or si_unit_of_name(name)
    )
    is_known = np.isfinite(channel.values)
    missing = np.flatnonzero(~is_known)
    if column.missing == "refuse" and len(missing):
        found = "none, or text" if np.isnan(channel.values[missing[0]]) else "an infinite one"
        raise DatasetError(
            f"{channel.place_of(missing[0])}: expected a number, found {found} "
            f"({len(missing)} of {len(is_known)} samples). Export the column without such cells, "
            f'or write missing = "skip" for {name} if other columns are sampled faster.'
        )
    kept = is_known & (channel.t_s >= begin_s + mapping.time.skip_first_s)
    if np.count_nonzero(kept) < 2:
        raise DatasetError(
            f"{channel.place}: expected at least two samples, found {np.count_nonzero(kept)}. "
            f"Leave the file out."
        )
    steps = np.diff(channel.t_s[kept])
    longest_s = column.longest_gap_s or mapping.time.longest_gap_s
    is_near = steps <= (longest_s or LONGEST_GAP_PERIODS * np.median(steps))
    return replace(
        channel,
        name=name,
        unit=scaling.si,
        t_s=channel.t_s[kept] - column.delay_s,
        values=scaling.factor * channel.values[kept] + scaling.offset,
        row=channel.row[kept],
        sampling=column.sampling,
        connected=is_near,
        gaps=tuple(np.flatnonzero(~is_near).tolist()),
    )


def _within_limits(mapping: LogMapping, series: Series, column: SignalMapping) -> Series:
    """The series, cut where it leaves `keep` or jumps; `DatasetError` if it is not plausible."""
    limits = limits_of(mapping.quantity(series.name), series.unit)
    low, high = column.plausible or (limits.low, limits.high)
    beyond = np.flatnonzero((series.values < low) | (series.values > high))
    if len(beyond):
        k = int(beyond[0])
        raise DatasetError(
            f"{series.place_of(k)}: expected {series.name} between {low:g} and {high:g} "
            f"{series.unit}, found {series.values[k]:.6g} ({len(beyond)} of {len(series.values)} "
            f"samples). Correct the unit in the mapping, or correct the log, or write plausible = "
            f"[low, high] for {series.name}."
        )
    series = _without_jumps(series, column.steepest_per_s or limits.steepest_per_s)
    if column.keep is None:
        return series
    is_kept = (series.values >= column.keep[0]) & (series.values <= column.keep[1])
    return replace(series, connected=series.connected & is_kept[:-1] & is_kept[1:])


def _without_jumps(series: Series, steepest_per_s: float) -> Series:
    """The series, cut where it changes faster than that."""
    steps = np.maximum(np.diff(series.t_s), SHORTEST_STEP_S)
    jumps = series.connected & (np.abs(np.diff(series.values)) > steepest_per_s * steps)
    return replace(series, connected=series.connected & ~jumps, jumps=int(np.count_nonzero(jumps)))


def find_stretches(drive: LoggedDrive) -> list[Stretch]:
    """The intervals in which all signals of a drive are known, in order."""
    changes = sorted(
        (float(series.t_s[k]), change)
        for series in drive.all_series
        for run in runs(series.connected)
        for k, change in zip(run, (1, -1), strict=True)
    )
    known, stretches = 0, []
    for (begin_s, change), (end_s, _) in pairwise(changes):
        known += change
        if known == len(drive.all_series):
            stretches.append(Stretch(begin_s, end_s))
    return stretches


def runs(is_true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each unbroken run of true values."""
    edges = np.flatnonzero(np.diff(is_true.astype(np.int8), prepend=0, append=0))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def grid(stretch: Stretch, period_s: float) -> Array:
    """Instants (T,) one period apart, from the beginning of a stretch to its end."""
    count = int((stretch.end_s - stretch.begin_s) / period_s + _SLACK) + 1
    return stretch.begin_s + period_s * np.arange(count, dtype=np.float64)


def resample(series: Series, stretch: Stretch, t_s: Array, period_s: float) -> Array:
    """The signal (T,) at these instants of a stretch, or its means over the periods after them.

    A signal with more than two samples per period is averaged over the period around each instant,
    which removes what the data set's period cannot represent; others are interpolated linearly.
    """
    first = max(int(np.searchsorted(series.t_s, stretch.begin_s, side="right")) - 1, 0)
    last = int(np.searchsorted(series.t_s, stretch.end_s, side="left"))
    own_t_s, values = series.t_s[first : last + 1], series.values[first : last + 1]
    if series.sampling is not Sampling.SAMPLED:
        is_held = series.sampling is Sampling.HELD
        return window_mean(own_t_s, values, t_s, t_s + period_s, is_held)
    if series.usual_step_s * AVERAGED_FROM > period_s:
        return np.interp(t_s, own_t_s, values)
    # Near the ends of a stretch the window is narrower on both sides, so that it stays centred.
    to_end = np.minimum(t_s - own_t_s[0], own_t_s[-1] - t_s)
    half = np.clip(to_end, 0.0, 0.5 * period_s)
    return window_mean(own_t_s, values, t_s - half, t_s + half, is_held=False)


def window_mean(t_s: Array, values: Array, low_s: Array, high_s: Array, is_held: bool) -> Array:
    """Means (T,) over windows of a signal that is held, or linear, between its samples.

    Windows are limited to the signal's duration; a window of zero width gives the value there.
    """
    steps = np.diff(t_s)
    heights = values[:-1] if is_held else 0.5 * (values[:-1] + values[1:])
    slopes = np.zeros_like(steps) if is_held else np.diff(values) / steps
    complete = np.concatenate([[0.0], np.cumsum(heights * steps)])

    def integral(until_s: Array) -> Array:
        k = np.clip(np.searchsorted(t_s, until_s, side="right") - 1, 0, len(steps) - 1)
        rest = until_s - t_s[k]
        return np.asarray(complete[k] + rest * (values[k] + 0.5 * slopes[k] * rest))

    low, high = (np.clip(edge, t_s[0], t_s[-1]) for edge in (low_s, high_s))
    k = np.searchsorted(t_s, low, side="right") - 1
    here = values[k] if is_held else np.interp(low, t_s, values)
    width = high - low
    has_width = width > _SLACK * np.maximum(high_s - low_s, _SLACK)
    mean = (integral(high) - integral(low)) / np.where(has_width, width, 1.0)
    return np.where(has_width, mean, here)
