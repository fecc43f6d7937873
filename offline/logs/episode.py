"""Episodes of a data set: stretches at one period, with their path states, cut to length."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np
import pandas as pd

from offline.config import PAST_STEPS, STEPS
from offline.logs.mapping import LogMapping
from offline.logs.series import LoggedDrive, Stretch, find_stretches, grid, resample, runs
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import VEHICLE, Schema, Signal
from rt_controller.mapping.reference_line import ReferenceLine

LEAST_SAMPLES = PAST_STEPS + STEPS + 1
"""of an episode: the past of a window, its steps, and its last state"""
LARGEST_DETOUR = 2.0
"""ratio of progress to the distance that the pose moved, above which the projection has jumped"""
_STANDING_M = 0.05


@dataclass(frozen=True, slots=True)
class LogEpisode:
    """Samples without gap, at the data set's period."""

    drive: str
    """name of its log"""
    begin_s: float
    """in the time of its log"""
    signals: pd.DataFrame
    """T rows; a column for each signal of the logs, and with a line the path states, curvature"""
    pose: Array
    """(T, 3), or (T, 0) without [pose]"""

    def __len__(self) -> int:
        return len(self.pose)

    def piece(self, begin: int, end: int, period_s: float) -> "LogEpisode":
        """The samples from `begin` to before `end`."""
        begin_s = self.begin_s + period_s * begin
        return LogEpisode(self.drive, begin_s, self.signals.iloc[begin:end], self.pose[begin:end])


class CutDrive(NamedTuple):
    """The episodes of one drive, and what was left out."""

    episodes: tuple[LogEpisode, ...]
    left_out: tuple[Stretch, ...]
    """too short for a window and its past"""
    stretches: int
    """without gap"""
    off_line: int
    """periods in which the pose was too far from the line, or its nearest point jumped"""


def make_schema(mapping: LogMapping, drives: Sequence[LoggedDrive]) -> Schema:
    """The signals of the data set in the units of the drives; `DatasetError` if these differ."""
    first = drives[0]
    for drive in drives[1:]:
        for one, other in zip(first.signals, drive.signals, strict=True):
            if one.unit != other.unit:
                raise DatasetError(
                    f"{other.place}: expected {one.name} in {one.unit} as in {first.name}, "
                    f"found {other.unit}. All logs of one import need the same units; convert that "
                    f"one."
                )
    units = {signal.name: signal.unit for signal in (*VEHICLE.states, *VEHICLE.exogenous)}
    units |= {series.name: series.unit for series in first.signals}
    states, inputs, exogenous = (
        tuple(Signal(name, units[name]) for name in names)
        for names in (mapping.state_names, mapping.inputs, mapping.exogenous_names)
    )
    return Schema(states, inputs, exogenous, mapping.period_s)


def cut_drive(drive: LoggedDrive, mapping: LogMapping, line: ReferenceLine | None) -> CutDrive:
    """The episodes of a drive, and the stretches that are too short for one."""
    stretches = find_stretches(drive)
    episodes: list[LogEpisode] = []
    left_out: list[Stretch] = []
    off_line = 0
    for stretch in stretches:
        sampled = _sample(drive, mapping.period_s, stretch)
        parts = [sampled]
        if line is not None and mapping.pose is not None:
            parts = _along_line(sampled, line, mapping.pose.farthest_m, mapping.period_s)
            off_line += len(sampled) - 1 - sum(len(part) for part in parts)
        for piece in (piece for part in parts for piece in _pieces(part, mapping)):
            if len(piece) >= LEAST_SAMPLES:
                episodes.append(piece)
            else:
                end_s = piece.begin_s + mapping.period_s * max(len(piece) - 1, 0)
                left_out.append(Stretch(piece.begin_s, end_s))
    return CutDrive(tuple(episodes), tuple(left_out), len(stretches), off_line)


def _sample(drive: LoggedDrive, period_s: float, stretch: Stretch) -> LogEpisode:
    t_s = grid(stretch, period_s)
    signals = {each.name: resample(each, stretch, t_s, period_s) for each in drive.signals}
    poses = [resample(each, stretch, t_s, period_s) for each in drive.poses]
    pose = np.stack(poses, axis=1) if poses else np.zeros((len(t_s), 0))
    return LogEpisode(drive.name, stretch.begin_s, pd.DataFrame(signals), pose)


def _along_line(
    sampled: LogEpisode, line: ReferenceLine, farthest_m: float, period_s: float
) -> list[LogEpisode]:
    """The parts of a stretch near the line, with their path states.

    Progress needs the sample before, so each part loses its first sample.
    """
    at = line.locate(sampled.pose)
    progress_m = line.progress(at.s_m)
    driven_m = np.hypot(*np.diff(sampled.pose[:, :2], axis=0).T)
    is_near = np.abs(at.ey_m) <= farthest_m
    is_projected = at.curvature_per_m * at.ey_m < 0.5
    is_inside = line.is_closed | ((at.s_m > 0.0) & (at.s_m < line.length_m))
    is_good = is_near & is_projected & is_inside
    has_not_jumped = np.abs(progress_m) <= LARGEST_DETOUR * driven_m + _STANDING_M
    parts = []
    for a, b in runs(is_good[:-1] & is_good[1:] & has_not_jumped):
        part = sampled.piece(a + 1, b + 1, period_s)
        signals = part.signals.assign(
            ds_m=progress_m[a:b],
            ey_m=at.ey_m[a + 1 : b + 1],
            epsi_rad=at.epsi_rad[a + 1 : b + 1],
            curvature_per_m=at.curvature_per_m[a + 1 : b + 1],
        )
        parts.append(replace(part, signals=signals))
    return parts


def _pieces(part: LogEpisode, mapping: LogMapping) -> list[LogEpisode]:
    """Pieces of equal length if the part is longer than `longest_episode_s`, else the part."""
    longest_s = mapping.split.longest_episode_s
    if longest_s is None or len(part) * mapping.period_s <= longest_s:
        return [part]
    count = ceil(len(part) * mapping.period_s / longest_s)
    edges = np.linspace(0, len(part), count + 1).astype(int)
    return [part.piece(int(a), int(b), mapping.period_s) for a, b in pairwise(edges)]
