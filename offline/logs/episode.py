"""Episodes of a data set: stretches at one period, cut to length; joined, and split into parts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from itertools import pairwise
from math import ceil, inf, radians
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.config import PAST_STEPS, STEPS
from offline.data.manifest import PARTS, Roads
from offline.data.recording import Anchor, Recording, Starts
from offline.logs.mapping import LogMapping, SplitSettings
from offline.logs.signal import LoggedDrive, Stretch, find_stretches, grid, resample, runs
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from rt_controller.mapping.reference_line import ReferenceLine
from rt_controller.mapping.tables import RoadsMapping

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
    for signal in (each for drive in drives for each in drive.signals):
        unit = next(each.unit for each in first.signals if each.name == signal.name)
        if signal.unit != unit:
            raise DatasetError(
                f"{signal.column.place}: expected {signal.name} in {unit} as in {first.name}, "
                f"found {signal.unit}. All logs of one import need the same units; convert that "
                f"one."
            )
    units = {each.name: each.unit for each in (*VEHICLE.states, *VEHICLE.exogenous)}
    units |= {signal.name: signal.unit for signal in first.signals}
    states, inputs, exogenous = (
        tuple(Signal(name, units[name]) for name in names)
        for names in (mapping.state_names, mapping.inputs, mapping.exogenous_names)
    )
    return Schema(states, inputs, exogenous, mapping.period_s)


def sample_drive(drive: LoggedDrive, mapping: LogMapping) -> list[LogEpisode]:
    """The stretches of a drive at the period of the data set, poses at the centre of gravity.

    The yaw of a log without heading is NaN.
    """
    sampled = []
    for stretch in find_stretches(drive):
        t_s = grid(stretch, mapping.period_s)
        signals, poses = (
            {each.name: resample(each, stretch, t_s, mapping.period_s) for each in series}
            for series in (drive.signals, drive.poses)
        )
        pose = np.zeros((len(t_s), 0))
        if mapping.pose is not None:
            yaw = poses.get("yaw", np.full(len(t_s), np.nan))
            ahead_m, left_m = mapping.pose.ahead_m, mapping.pose.left_m
            x, y = poses["x"], poses["y"]
            if ahead_m or left_m:
                x = x - ahead_m * np.cos(yaw) + left_m * np.sin(yaw)
                y = y - ahead_m * np.sin(yaw) - left_m * np.cos(yaw)
            pose = np.stack([x, y, yaw], axis=1)
        sampled.append(LogEpisode(drive.name, stretch.begin_s, pd.DataFrame(signals), pose))
    return sampled


def cut_drive(
    stretches: Sequence[LogEpisode], mapping: LogMapping, line: ReferenceLine | None
) -> CutDrive:
    """The episodes of the stretches of a drive, and what is too short for one."""
    period_s = mapping.period_s
    episodes: list[LogEpisode] = []
    left_out: list[Stretch] = []
    off_line = 0
    for sampled in stretches:
        parts = [sampled]
        if line is not None and mapping.pose is not None:
            parts = _along_line(sampled, line, mapping.pose.farthest_m, period_s)
            off_line += len(sampled) - 1 - sum(len(part) for part in parts)
        for piece in (piece for part in parts for piece in _pieces(part, mapping)):
            if len(piece) >= LEAST_SAMPLES:
                episodes.append(piece)
            else:
                end_s = piece.begin_s + period_s * max(len(piece) - 1, 0)
                left_out.append(Stretch(piece.begin_s, end_s))
    return CutDrive(tuple(episodes), tuple(left_out), len(stretches), off_line)


def _along_line(
    sampled: LogEpisode, line: ReferenceLine, farthest_m: float, period_s: float
) -> list[LogEpisode]:
    """The parts of a stretch near the line, with their path states.

    Progress needs the sample before, so each part loses its first sample.
    """
    at = line.locate(sampled.pose)
    progress_m = line.progress(at.s_m)
    driven_m = np.hypot(*np.diff(sampled.pose[:, :2], axis=0).T)
    is_good = (np.abs(at.ey_m) <= farthest_m) & (at.curvature_per_m * at.ey_m < 0.5)
    is_good &= line.is_closed | ((at.s_m > 0.0) & (at.s_m < line.length_m))
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
    """The part, in pieces of equal length if it is longer than `longest_episode_s`."""
    longest_s = mapping.split.longest_episode_s or inf
    count = max(1, ceil(len(part) * mapping.period_s / longest_s))
    edges = np.linspace(0, len(part), count + 1).astype(int).tolist()
    return [part.piece(a, b, mapping.period_s) for a, b in pairwise(edges)]


def join_episodes(episodes: Sequence[LogEpisode], mapping: LogMapping) -> Recording:
    """The episodes, one after the other; with poses only if roads are placed under them."""
    signals = pd.concat([episode.signals for episode in episodes])
    w, pose = signals.filter(mapping.exogenous_names), np.zeros((0, 3))
    if mapping.places_roads:
        # The road of the drive itself is unknown.
        w = np.zeros((len(signals), len(mapping.exogenous_names)))
        pose = np.concatenate([episode.pose for episode in episodes])
    return Recording(
        x=np.asarray(signals.filter(mapping.state_names), dtype=np.float32),
        u=np.asarray(signals[list(mapping.inputs)], dtype=np.float32),
        w=np.asarray(w, dtype=np.float32),
        pose=pose,
        first=np.cumsum([0, *(len(episode) for episode in episodes[:-1])], dtype=np.int64),
    )


def slice_windows(recording: Recording, roads: Roads | None, seed: int) -> Starts:
    """Windows side by side in every episode, after the past of the first window.

    Neighbouring windows share one state and no input. If roads are placed, each window gets a
    random road, lateral error and heading error.
    """
    counts = (recording.lengths - 1 - PAST_STEPS) // STEPS
    episode = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    number = np.concatenate([np.arange(count) for count in counts])
    row = recording.first[episode] + PAST_STEPS + STEPS * number
    anchor = None
    if roads is not None:
        rng = np.random.default_rng([seed, len(episode)])
        anchor = Anchor(
            rng.choice(np.array(roads.curvatures_per_m), len(episode)),
            roads.ey_m * rng.uniform(-1.0, 1.0, len(episode)),
            roads.epsi_rad * rng.uniform(-1.0, 1.0, len(episode)),
        )
    return Starts(row.astype(np.int64), episode, anchor)


def roads_of(mapping: LogMapping) -> Roads | None:
    """The roads that may be placed under the drives; None without poses or with a line."""
    if not mapping.places_roads:
        return None
    roads = mapping.pose.roads if mapping.pose else RoadsMapping()
    return Roads(roads.curvatures_per_m, roads.ey_m, radians(roads.epsi_deg))


def assign_parts(files: Sequence[str], settings: SplitSettings) -> NDArray[np.int8]:
    """Index (E,) into `PARTS` of each episode; `files` (E) has the name of each one's log.

    Files with a pattern in the mapping are held back as it says. The parts without a pattern get a
    random share of the rest, at least one, by episode or by file.

    Raises:
        ConfigError: a pattern fits no file, or a file is in both parts.
        DatasetError: too few episodes or files for three parts.
    """
    named = {name: _named(files, name, getattr(settings, name)) for name in PARTS[1:]}
    both = sorted(set.intersection(*named.values()))
    if both:
        raise ConfigError(
            f"[split]: expected each file in one part, found in validation and in test: "
            f"{', '.join(both)}."
        )
    taken = set.union(*named.values())
    units = [file if settings.by == "file" else str(e) for e, file in enumerate(files)]
    free = list(dict.fromkeys(u for u, f in zip(units, files, strict=True) if f not in taken))
    rng = np.random.default_rng([settings.seed, len(free)])
    drawn = [free[k] for k in rng.permutation(len(free))]
    count = max(1, round(settings.share * len(drawn)))
    part = np.full(len(files), PARTS.index("train"), dtype=np.int8)
    for name, own in named.items():
        if own:
            part[[file in own for file in files]] = PARTS.index(name)
        else:
            chosen, drawn = drawn[:count], drawn[count:]
            part[[unit in chosen for unit in units]] = PARTS.index(name)
    for k, name in enumerate(PARTS):
        if k not in part:
            raise DatasetError(
                f"expected episodes for train, validation and test, found none for {name}: "
                f"{len(files)} episodes of {len(set(files))} files, split by {settings.by}. Name "
                f"other files in [split], set longest_episode_s there to cut long drives into "
                f"several, or record more."
            )
    return part


def _named(files: Sequence[str], part: str, patterns: Sequence[str]) -> set[str]:
    """The files that fit the patterns of one part."""
    for pattern in patterns:
        if not any(fnmatch(file, pattern) for file in files):
            raise ConfigError(
                f"[split] {part}: expected names or patterns of logs with episodes, found "
                f"{pattern!r}, which fits none of {', '.join(sorted(set(files)))}."
            )
    return {file for file in files if any(fnmatch(file, pattern) for pattern in patterns)}
