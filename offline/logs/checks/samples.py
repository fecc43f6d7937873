"""Checks of the samples of each signal: coverage, gaps, values far from all others, increments."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from offline.logs.series import LoggedDrive
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema
from rt_controller.mapping.quantity import Quantity

BINS = 8


@dataclass(frozen=True, slots=True)
class Range:
    """Quantiles of one signal."""

    name: str
    unit: str
    lowest: float
    q05: float
    median: float
    q95: float
    highest: float


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Joint histogram of two signals."""

    across: str
    """signal of the columns, with its unit"""
    down: str
    across_edges: tuple[float, ...]
    """BINS + 1"""
    down_edges: tuple[float, ...]
    share: tuple[tuple[float, ...], ...]
    """(BINS, BINS) of all samples, rows by `down`"""
    filled: float
    """share of the cells that contain a sample"""


def find_ranges(episodes: Sequence[LogEpisode], schema: Schema) -> list[Range]:
    """Ranges and quantiles of all signals that were measured, or computed from a line."""
    signals = pd.concat([episode.signals for episode in episodes])
    quantiles = signals.quantile([0.0, 0.05, 0.5, 0.95, 1.0])
    return [
        Range(signal.name, signal.unit, *quantiles[signal.name].tolist())
        for signal in (*schema.states, *schema.inputs, *schema.exogenous)
        if signal.name in signals
    ]


def find_occupancy(episodes: Sequence[LogEpisode], mapping: LogMapping) -> Occupancy | None:
    """Speed and lateral acceleration (speed times yaw rate), or else speed and steering.

    None if the logs have no speed, or neither of the others.
    """
    speed = mapping.name_of(Quantity.SPEED)
    yaw_rate, steer = mapping.name_of(Quantity.YAW_RATE), mapping.name_of(Quantity.STEERING)
    if speed is None or not (yaw_rate or steer):
        return None
    signals = pd.concat([episode.signals for episode in episodes])
    lateral = signals[speed] * signals[yaw_rate] if yaw_rate else signals[steer]
    counts, down_edges, across_edges = np.histogram2d(signals[speed], lateral, bins=BINS)
    return Occupancy(
        "lateral acceleration, m/s^2" if yaw_rate else f"{steer}, rad",
        f"{speed}, m/s",
        tuple(across_edges.tolist()),
        tuple(down_edges.tolist()),
        tuple(map(tuple, (counts / counts.sum()).tolist())),
        float(np.mean(counts > 0)),
    )


FAR = 10.0
"""robust z-score of a value"""
SUDDEN = 80.0
"""robust z-score of an increment between two samples; hard steering in good logs reaches 60"""
_STD_PER_MAD = 1.4826
"""standard deviation of a normal distribution over its median absolute deviation"""
_LEAST_SHARE_OF_STD = 0.2
"""a pedal that is mostly released has a median absolute deviation of zero"""


@dataclass(frozen=True, slots=True)
class Issue:
    """Something in the logs that the user should look at before training."""

    check: str
    subject: str
    """signal or file"""
    message: str
    """what is unusual, and what to do about it"""


@dataclass(frozen=True, slots=True)
class Gaps:
    """The gaps of one log, for its signal with the longest ones."""

    file: str
    number: int
    missing_s: float
    """sum of all gaps"""
    first: str
    """signal and row after the first of them, or ''"""


def find_gaps(drive: LoggedDrive) -> Gaps:
    """The gaps of one log: samples farther apart than the mapping bridges."""
    worst = max(drive.all_series, key=lambda series: series.missing_s)
    if not worst.gaps:
        return Gaps(drive.name, 0, 0.0, "")
    first = f"{worst.name}, {worst.of.word} {worst.row[worst.gaps[0] + 1]}"
    return Gaps(drive.name, len(worst.gaps), worst.missing_s, first)


def gap_issues(found: Sequence[Gaps]) -> Iterator[Issue]:
    """One issue for each log with gaps."""
    for each in found:
        if each.number:
            yield Issue(
                "gaps",
                each.file,
                f"{each.number} without samples, {each.missing_s:.3g} s in all, the first before "
                f"{each.first}: the drive is cut there. longest_gap_s of [time] or of the signal "
                f"bridges longer ones by linear interpolation",
            )


@dataclass(frozen=True, slots=True)
class Outliers:
    """Outliers of one signal, over all logs: values beyond `FAR`, increments beyond `SUDDEN`."""

    name: str
    unit: str
    far: int
    sudden: int
    jumps: int
    """increments that no vehicle can make, where the drives were cut"""
    worst: str
    """place of the largest increment, or ''"""
    worst_z: float


def find_outliers(drives: Sequence[LoggedDrive]) -> list[Outliers]:
    """Outliers of each signal and of the poses, in the samples as recorded."""
    found = []
    for of_drives in zip(*(drive.all_series for drive in drives), strict=True):
        value_z = robust_z(np.concatenate([series.values for series in of_drives]))
        step_z = np.abs(robust_z(np.concatenate([np.diff(series.values) for series in of_drives])))
        step_z *= np.concatenate([series.connected for series in of_drives])
        rows = np.concatenate([series.row[1:] for series in of_drives])
        drive_of_row = np.repeat(np.arange(len(drives)), [len(s.row) - 1 for s in of_drives])
        k = int(np.argmax(step_z))
        drive = drives[drive_of_row[k]]
        found.append(
            Outliers(
                of_drives[0].name,
                of_drives[0].unit,
                int(np.count_nonzero(np.abs(value_z) > FAR)),
                int(np.count_nonzero(step_z > SUDDEN)),
                sum(series.jumps for series in of_drives),
                f"{drive.name}, {of_drives[0].of.word} {rows[k]}",
                float(step_z[k]),
            )
        )
    return found


def robust_z(values: Array) -> Array:
    """Distance of each value from the median, in robust standard deviations."""
    away = values - np.median(values)
    spread = max(
        _STD_PER_MAD * float(np.median(np.abs(away))), _LEAST_SHARE_OF_STD * float(np.std(away))
    )
    return away / spread if spread > 0.0 else np.zeros_like(away)


def outlier_issues(found: Sequence[Outliers], pedals: Sequence[str]) -> Iterator[Issue]:
    """One issue for each signal with jumps, and for each with outliers that is not a pedal.

    A pedal rests most of the time and then moves quickly, so its outliers are normal.
    """
    for each in found:
        if each.jumps:
            yield Issue(
                "jumps",
                each.name,
                f"{each.jumps} increments are larger than a vehicle can make; the drives are cut "
                f"there. skip_first_s in [time] leaves out filters that settle, steepest_per_s "
                f"sets the limit",
            )
        if (each.far or each.sudden) and each.name not in pedals:
            yield Issue(
                "outliers",
                each.name,
                f"{each.far} values and {each.sudden} increments stand out, the largest increment "
                f"at {each.worst} ({each.worst_z:.0f} robust standard deviations); keep or "
                f"plausible limits the signal",
            )
