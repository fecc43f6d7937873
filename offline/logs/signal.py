"""The signals of a drive in SI: from columns of a log, checked sample by sample, to one period."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.logs.mapping import GEOGRAPHIC_WITH_LINE, LogMapping
from offline.logs.readers.log import Log, LogColumn
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


@dataclass(frozen=True, slots=True)
class LogSignal:
    """A signal of one log in SI."""

    name: str
    unit: str
    t_s: Array
    """(N,) time of measurement, increasing; delays are subtracted"""
    values: Array
    """(N,) finite"""
    row: NDArray[np.int64]
    """(N,) row number of each sample in the file"""
    column: LogColumn
    """that it was made of"""
    sampling: Sampling
    connected: NDArray[np.bool_]
    """(N-1,) whether it is known between a sample and the next"""
    gaps: tuple[int, ...] = ()
    """samples whose next one is too far away to bridge"""
    jumps: int = 0
    """how often it changed faster than possible"""

    def place_of(self, sample: int) -> str:
        """File, column and row of a sample, for messages."""
        return f"{self.column.place}, {self.column.word} {self.row[sample]}"

    @property
    def usual_step_s(self) -> float:
        """Median time between two samples."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def missing_s(self) -> float:
        """Sum of all gaps."""
        return float(np.diff(self.t_s)[list(self.gaps)].sum())


class LoggedDrive(NamedTuple):
    """All signals of one log, and its poses if the mapping has [pose]."""

    name: str
    rows: int
    """in its longest file"""
    signals: tuple[LogSignal, ...]
    """in the order of `LogMapping.read_signals`"""
    poses: tuple[LogSignal, ...] = ()
    """x, y, and yaw continuous over full turns; or none"""

    @property
    def all_signals(self) -> tuple[LogSignal, ...]:
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
    begin_s = min((each.t_s[0] for each in log.columns if len(each.t_s)), default=0.0)
    signals = tuple(
        _within_limits(mapping, _to_signal(log, mapping, begin_s, name, column), column)
        for name, column in mapping.read_signals.items()
    )
    poses = []
    for (name, unit, _), pose in zip(POSE_SIGNALS, mapping.pose_columns, strict=False):
        own = pose.unit or log.column(*pose.names, file=pose.file).unit
        signal = _to_signal(log, mapping, begin_s, name, pose, "rad" if is_angle(own) else unit)
        if signal.unit == "rad":
            signal = replace(signal, values=np.unwrap(signal.values))
        poses.append(signal)
    if any(signal.unit == "rad" for signal in poses[:2]):
        if mapping.pose is not None and mapping.pose.reference_line is not None:
            raise DatasetError(f"{poses[0].column.place}: {GEOGRAPHIC_WITH_LINE}.")
        poses[:2] = _on_plane(*poses[:2])
    steepest = (each for _, _, each in POSE_SIGNALS)
    found = tuple(map(_without_jumps, poses, steepest))
    return LoggedDrive(log.name, log.rows, signals, found)


def _on_plane(longitude: LogSignal, latitude: LogSignal) -> tuple[LogSignal, LogSignal]:
    """East and north in m, on the tangent plane of the WGS 84 ellipsoid at the first point.

    With the radii of curvature of the meridian and of the prime vertical there.
    """
    if longitude.unit != latitude.unit:
        raise DatasetError(
            f"{longitude.column.place}, and {latitude.column.place}: expected x and y both in m, "
            f"or longitude and latitude in deg, found {longitude.unit} and {latitude.unit}. "
            f"Correct their columns or units in [pose]."
        )
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


def _to_signal(
    log: Log,
    mapping: LogMapping,
    begin_s: float,
    name: str,
    settings: ColumnMapping,
    unit: str | None = None,
) -> LogSignal:
    column = log.column(*settings.names, file=settings.file)
    scaling = scaling_of(
        column.place, column.unit or None, settings, name, unit or si_unit_of_name(name)
    )
    is_known = np.isfinite(column.values)
    missing = np.flatnonzero(~is_known)
    if settings.missing == "refuse" and len(missing):
        found = "none, or text" if np.isnan(column.values[missing[0]]) else "an infinite one"
        raise DatasetError(
            f"{column.place_of(missing[0])}: expected a number, found {found} "
            f"({len(missing)} of {len(is_known)} samples). Export the column without such cells, "
            f'or write missing = "skip" for {name} if other columns are sampled faster.'
        )
    kept = is_known & (column.t_s >= begin_s + mapping.time.skip_first_s)
    if np.count_nonzero(kept) < 2:
        raise DatasetError(
            f"{column.place}: expected at least two samples, found {np.count_nonzero(kept)}. "
            f"Leave the file out."
        )
    steps = np.diff(column.t_s[kept])
    longest_s = settings.longest_gap_s or mapping.time.longest_gap_s
    is_near = steps <= (longest_s or LONGEST_GAP_PERIODS * np.median(steps))
    return LogSignal(
        name=name,
        unit=scaling.si,
        t_s=column.t_s[kept] - settings.delay_s,
        values=scaling.factor * column.values[kept] + scaling.offset,
        row=column.row[kept],
        column=column,
        sampling=settings.sampling,
        connected=is_near,
        gaps=tuple(np.flatnonzero(~is_near).tolist()),
    )


def _within_limits(mapping: LogMapping, signal: LogSignal, column: SignalMapping) -> LogSignal:
    """The signal, cut where it leaves `keep` or jumps; `DatasetError` if it is not plausible."""
    limits = limits_of(mapping.quantity(signal.name), signal.unit)
    low, high = column.plausible or (limits.low, limits.high)
    beyond = np.flatnonzero((signal.values < low) | (signal.values > high))
    if len(beyond):
        k = int(beyond[0])
        raise DatasetError(
            f"{signal.place_of(k)}: expected {signal.name} between {low:g} and {high:g} "
            f"{signal.unit}, found {signal.values[k]:.6g} ({len(beyond)} of {len(signal.values)} "
            f"samples). Correct the unit in the mapping, or correct the log, or write plausible = "
            f"[low, high] for {signal.name}."
        )
    signal = _without_jumps(signal, column.steepest_per_s or limits.steepest_per_s)
    if column.keep is None:
        return signal
    is_kept = (signal.values >= column.keep[0]) & (signal.values <= column.keep[1])
    return replace(signal, connected=signal.connected & is_kept[:-1] & is_kept[1:])


def _without_jumps(signal: LogSignal, steepest_per_s: float) -> LogSignal:
    """The signal, cut where it changes faster than that."""
    steps = np.maximum(np.diff(signal.t_s), SHORTEST_STEP_S)
    jumps = signal.connected & (np.abs(np.diff(signal.values)) > steepest_per_s * steps)
    return replace(signal, connected=signal.connected & ~jumps, jumps=int(np.count_nonzero(jumps)))


def find_stretches(drive: LoggedDrive) -> list[Stretch]:
    """The intervals in which all signals of a drive are known, in order."""
    changes = sorted(
        (float(signal.t_s[k]), change)
        for signal in drive.all_signals
        for run in runs(signal.connected)
        for k, change in zip(run, (1, -1), strict=True)
    )
    known, stretches = 0, []
    for (begin_s, change), (end_s, _) in pairwise(changes):
        known += change
        if known == len(drive.all_signals):
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


def resample(signal: LogSignal, stretch: Stretch, t_s: Array, period_s: float) -> Array:
    """The signal (T,) at these instants of a stretch, or its means over the periods after them.

    A signal with more than two samples per period is averaged over the period around each instant,
    which removes what the data set's period cannot represent; others are interpolated linearly.
    """
    first = max(int(np.searchsorted(signal.t_s, stretch.begin_s, side="right")) - 1, 0)
    last = int(np.searchsorted(signal.t_s, stretch.end_s, side="left"))
    own_t_s, values = signal.t_s[first : last + 1], signal.values[first : last + 1]
    if signal.sampling is not Sampling.SAMPLED:
        is_held = signal.sampling is Sampling.HELD
        return window_mean(own_t_s, values, t_s, t_s + period_s, is_held)
    if signal.usual_step_s * AVERAGED_FROM > period_s:
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
