"""Episodes of a data set: stretches at one period, with their path states, cut to length."""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offline.lengths import PAST_STEPS, STEPS
from offline.logs.log import Array
from offline.logs.mapping import Mapping
from offline.logs.reference_line import ReferenceLine
from offline.logs.series import Drive
from offline.logs.stretch import Stretch, find_stretches, grid, resample, runs
from offline.recording import PATH_STATES
from rt_controller.contract.schema import VEHICLE, Schema, Signal

LEAST_SAMPLES = PAST_STEPS + STEPS + 1
"""of an episode: one window of steps, what came before it, and its last state"""
LARGEST_DETOUR = 2.0
"""progress against the way that the pose itself went, from which the projection has jumped"""
_STANDING_M = 0.05


@dataclass(frozen=True, slots=True)
class Episode:
    """Samples without gap, at the data set's period."""

    path: Path
    begin_s: float
    """in the time of its log"""
    x: Array
    """(T, n) states; with poses but no reference line, those of the car only"""
    u: Array
    """(T, m)"""
    w: Array
    """(T, p)"""
    pose: Array
    """(T, 3), or (T, 0) where the mapping asks for none"""

    def piece(self, begin: int, end: int, period_s: float) -> "Episode":
        """The samples from `begin` to before `end`."""
        return Episode(
            self.path,
            self.begin_s + period_s * begin,
            self.x[begin:end],
            self.u[begin:end],
            self.w[begin:end],
            self.pose[begin:end],
        )


class Cut(NamedTuple):
    """What became of a drive."""

    episodes: tuple[Episode, ...]
    left_out: tuple[Stretch, ...]
    """too short for a window and its past"""
    stretches: int
    """without gap"""
    off_line: int
    """periods in which the pose was too far from the line, or its nearest point leapt"""


def make_schema(mapping: Mapping, drive: Drive) -> Schema:
    """The signals of the data set, with the units that those of a drive became."""
    units = {series.name: series.unit for series in drive.signals}
    path = tuple(VEHICLE.states[-len(PATH_STATES) :]) if mapping.pose else ()
    return Schema(
        states=(*(Signal(name, units[name]) for name in mapping.states), *path),
        inputs=tuple(Signal(name, units[name]) for name in mapping.inputs),
        exogenous=(
            *(Signal(name, units[name]) for name in mapping.exogenous),
            *(VEHICLE.exogenous if mapping.pose else ()),
        ),
        dt_s=mapping.period_s,
    )


def cut_episodes(drive: Drive, mapping: Mapping, line: ReferenceLine | None) -> Cut:
    """The episodes of a drive, and what is too short to be one."""
    stretches = find_stretches(drive)
    episodes: list[Episode] = []
    left_out: list[Stretch] = []
    off_line = 0
    for stretch in stretches:
        whole = _sample(drive, mapping, stretch)
        parts = [whole]
        if line is not None:
            parts = _along_line(whole, line, mapping)
            off_line += len(whole.x) - 1 - sum(len(part.x) for part in parts)
        for part in parts:
            for piece in _pieces(part, mapping):
                if len(piece.x) >= LEAST_SAMPLES:
                    episodes.append(piece)
                else:
                    end_s = piece.begin_s + mapping.period_s * max(len(piece.x) - 1, 0)
                    left_out.append(Stretch(piece.begin_s, end_s))
    return Cut(tuple(episodes), tuple(left_out), len(stretches), off_line)


def _sample(drive: Drive, mapping: Mapping, stretch: Stretch) -> Episode:
    t_s = grid(stretch, mapping.period_s)
    signals = {
        series.name: resample(series, stretch, t_s, mapping.period_s) for series in drive.signals
    }
    poses = [resample(series, stretch, t_s, mapping.period_s) for series in drive.poses]

    def stack(names: list[Array]) -> Array:
        return np.stack(names, axis=1) if names else np.zeros((len(t_s), 0))

    w = stack([signals[name] for name in mapping.exogenous])
    if mapping.pose and not mapping.follows_line:
        # Roads are laid later; which one the drive was meant for is not known.
        w = np.zeros((len(t_s), len(VEHICLE.exogenous)))
    return Episode(
        drive.path,
        stretch.begin_s,
        stack([signals[name] for name in mapping.states]),
        stack([signals[name] for name in mapping.inputs]),
        w,
        stack(poses),
    )


def _along_line(whole: Episode, line: ReferenceLine, mapping: Mapping) -> list[Episode]:
    """The parts of a stretch that can be told against the line, with their path states.

    Progress looks back one period, so the first sample of a part is given up for it.
    """
    if mapping.pose is None:
        return [whole]
    at = line.locate(whole.pose)
    way = line.progress(at.s_m)
    driven = np.hypot(*np.diff(whole.pose[:, :2], axis=0).T)
    is_near = np.abs(at.ey_m) <= mapping.pose.farthest_m
    is_beside = at.curvature_per_m * at.ey_m < 0.5
    is_inside = line.is_closed | ((at.s_m > 0.0) & (at.s_m < line.length_m))
    is_fine = is_near & is_beside & is_inside
    follows = np.abs(way) <= LARGEST_DETOUR * driven + _STANDING_M
    joined = is_fine[:-1] & is_fine[1:] & follows
    path = np.stack([way, at.ey_m[1:], at.epsi_rad[1:]], axis=1)
    parts = []
    for a, b in runs(joined):
        part = whole.piece(a + 1, b + 1, mapping.period_s)
        curvature_per_m = at.curvature_per_m[a + 1 : b + 1, None]
        parts.append(
            replace(
                part,
                x=np.concatenate([part.x, path[a:b]], axis=1),
                w=np.concatenate([part.w, curvature_per_m], axis=1),
            )
        )
    return parts


def _pieces(part: Episode, mapping: Mapping) -> list[Episode]:
    """The episode, or pieces of it of equal length where it is longer than wanted."""
    longest_s = mapping.split.longest_episode_s
    if longest_s is None or len(part.x) * mapping.period_s <= longest_s:
        return [part]
    count = ceil(len(part.x) * mapping.period_s / longest_s)
    edges = np.linspace(0, len(part.x), count + 1).astype(int)
    return [part.piece(int(a), int(b), mapping.period_s) for a, b in pairwise(edges)]


def column(episode: Episode, schema: Schema, name: str) -> Array:
    """One signal (T,) of an episode, which has it."""
    for block, names in (
        (episode.x, schema.state_names),
        (episode.u, schema.input_names),
        (episode.w, schema.exogenous_names),
    ):
        if name in names:
            return np.asarray(block[:, names.index(name)])
    raise KeyError(name)
