"""Episodes as one recording: its windows, its roads, and the parts held back from training."""

from collections.abc import Sequence
from fnmatch import fnmatch
from math import radians

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.config import PAST_STEPS, STEPS
from offline.data.dataset import PARTS
from offline.data.manifest import Roads
from offline.data.recording import Recording, Starts
from offline.data.road_frame import Anchor
from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping, SplitSettings
from rt_controller.contract.errors import ConfigError, DatasetError


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
    begins = zip(recording.first + PAST_STEPS, counts, strict=True)
    rows = [begin + STEPS * np.arange(count) for begin, count in begins]
    episode = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    anchor = None
    if roads is not None:
        rng = np.random.default_rng([seed, len(episode)])
        anchor = Anchor(
            rng.choice(np.array(roads.curvatures_per_m), len(episode)),
            roads.ey_m * rng.uniform(-1.0, 1.0, len(episode)),
            roads.epsi_rad * rng.uniform(-1.0, 1.0, len(episode)),
        )
    return Starts(np.concatenate(rows).astype(np.int64), episode, anchor)


def roads_of(mapping: LogMapping) -> Roads | None:
    """The roads that may be placed under the drives; None without poses or with a line."""
    if mapping.pose is None or not mapping.places_roads:
        return None
    roads = mapping.pose.roads
    return Roads(roads.curvatures_per_m, roads.ey_m, radians(roads.epsi_deg))


def assign_parts(files: Sequence[str], settings: SplitSettings) -> NDArray[np.int8]:
    """Index (E,) into `PARTS` of each episode; `files` (E) has the name of each one's log.

    Files with a pattern in the mapping are held back as it says. The parts without a pattern get a
    random share of the rest, at least one, by episode or by file.

    Raises:
        ConfigError: a pattern fits no file, or a file is in both parts.
        DatasetError: too few episodes or files for three parts.
    """
    validation = _named(files, "validation", settings.validation)
    test = _named(files, "test", settings.test)
    if validation & test:
        raise ConfigError(
            f"[split]: expected each file in one part, found in validation and in test: "
            f"{', '.join(sorted(validation & test))}."
        )
    free = [e for e, file in enumerate(files) if file not in validation | test]
    units = [files[e] if settings.by == "file" else str(e) for e in free]
    unique = list(dict.fromkeys(units))
    order = np.random.default_rng([settings.seed, len(unique)]).permutation(len(unique))
    drawn = [unique[k] for k in order]
    count = max(1, round(settings.share * len(drawn)))
    part = np.full(len(files), PARTS.index("train"), dtype=np.int8)
    for name, named in (("validation", validation), ("test", test)):
        if named:
            held_back = [e for e, file in enumerate(files) if file in named]
        else:
            chosen, drawn = drawn[:count], drawn[count:]
            held_back = [e for e, unit in zip(free, units, strict=True) if unit in chosen]
        part[held_back] = PARTS.index(name)
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
    named: set[str] = set()
    for pattern in patterns:
        fits = {file for file in files if fnmatch(file, pattern)}
        if not fits:
            raise ConfigError(
                f"[split] {part}: expected names or patterns of logs with episodes, found "
                f"{pattern!r}, which fits none of {', '.join(sorted(set(files)))}."
            )
        named |= fits
    return named
