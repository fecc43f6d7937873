"""Samples that stand out: far from all others, or moving as no other does."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.logs.finding import Finding
from offline.logs.log import Array
from offline.logs.series import Drive, Series

FAR = 10.0
"""robust z-score of a value"""
SUDDEN = 80.0
"""of an increment between two samples; hard steering in good logs reaches 60"""
_PER_MAD = 1.4826
"""standard deviation of a normal distribution in units of its median absolute deviation"""
_LEAST_SHARE_OF_STD = 0.2
"""a pedal that is mostly released has a median deviation of zero"""


class Outliers(NamedTuple):
    """What stands out of one signal, over all logs."""

    name: str
    unit: str
    far: int
    """values beyond `FAR`"""
    sudden: int
    """increments beyond `SUDDEN`"""
    jumps: int
    """increments that no vehicle makes, where the drives were cut"""
    worst: str
    """where the most sudden increment is, or ''"""
    worst_z: float


def find_outliers(drives: Sequence[Drive]) -> list[Outliers]:
    """What stands out of each signal and of the poses, in the samples as they were recorded."""
    return [
        _of_signal(drives, [drive.all_series[i] for drive in drives])
        for i in range(len(drives[0].all_series))
    ]


def robust_z(values: Array) -> Array:
    """Distance of each value from the median, in robust standard deviations."""
    away = values - np.median(values)
    spread = max(
        _PER_MAD * float(np.median(np.abs(away))), _LEAST_SHARE_OF_STD * float(np.std(away))
    )
    return away / spread if spread > 0.0 else np.zeros_like(away)


def remarks(found: Sequence[Outliers], pedals: Sequence[str]) -> list[Finding]:
    """One finding for each signal that has jumps, or outliers and is no pedal.

    Feet rest most of the time and then move at once: that stands out and is nothing to look at.
    """
    findings = []
    for each in found:
        if each.jumps:
            findings.append(
                Finding(
                    "jumps",
                    each.name,
                    f"{each.jumps} increments faster than a vehicle moves; the drives are cut "
                    f"there. skip_first_s in [time] leaves out filters that settle, "
                    f"steepest_per_s sets the limit",
                )
            )
        if (each.far or each.sudden) and each.name not in pedals:
            findings.append(
                Finding(
                    "outliers",
                    each.name,
                    f"{each.far} values and {each.sudden} increments stand out, the most sudden "
                    f"at {each.worst} ({each.worst_z:.0f} robust standard deviations); keep or "
                    f"plausible bounds the signal",
                )
            )
    return findings


def _of_signal(drives: Sequence[Drive], series: Sequence[Series]) -> Outliers:
    far = int(np.count_nonzero(np.abs(robust_z(np.concatenate([s.values for s in series]))) > FAR))
    z = np.abs(robust_z(np.concatenate([np.diff(s.values) for s in series])))
    is_known = np.concatenate([s.bridged for s in series])
    z = np.where(is_known, z, 0.0)
    sudden = int(np.count_nonzero(z > SUDDEN))
    k = int(np.argmax(z))
    worst, worst_z = "", float(z[k])
    for drive, each in zip(drives, series, strict=True):
        if k < len(each.values) - 1:
            worst = f"{drive.path.name}, {drive.row_word} {each.row[k + 1]}"
            break
        k -= len(each.values) - 1
    jumps = sum(each.jumps for each in series)
    return Outliers(series[0].name, series[0].unit, far, sudden, jumps, worst, worst_z)
