"""Episodes as one recording, with the slices that every model is judged on."""

from collections.abc import Sequence
from math import radians

import numpy as np

from offline.lengths import PAST_STEPS, STEPS
from offline.logs.episode import Episode
from offline.logs.mapping import Mapping
from offline.manifest import Roads
from offline.recording import Recording, Starts
from offline.road_frame import Anchor


def assemble(episodes: Sequence[Episode], mapping: Mapping) -> Recording:
    """The episodes, one after the other; with poses only where roads are laid under them."""
    lengths = [len(episode.x) for episode in episodes]
    is_laid = mapping.pose is not None and not mapping.follows_line
    return Recording(
        x=np.concatenate([episode.x for episode in episodes]).astype(np.float32),
        u=np.concatenate([episode.u for episode in episodes]).astype(np.float32),
        w=np.concatenate([episode.w for episode in episodes]).astype(np.float32),
        pose=np.concatenate([e.pose for e in episodes]) if is_laid else np.zeros((0, 3)),
        first=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
    )


def slice_windows(recording: Recording, roads: Roads | None, seed: int) -> Starts:
    """Windows side by side in every episode, each with its past before it.

    Neighbours share the state between them and no input. Where roads are laid, each window has
    one of its own, drawn with lateral and heading error.
    """
    counts = (recording.lengths - 1 - PAST_STEPS) // STEPS
    rows = [
        first + PAST_STEPS + STEPS * np.arange(count)
        for first, count in zip(recording.first, counts, strict=True)
    ]
    episode = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    anchor = None
    if roads is not None:
        dice = np.random.default_rng([seed, len(episode)])
        anchor = Anchor(
            dice.choice(np.array(roads.curvatures_per_m), len(episode)),
            roads.ey_m * dice.uniform(-1.0, 1.0, len(episode)),
            roads.epsi_rad * dice.uniform(-1.0, 1.0, len(episode)),
        )
    return Starts(np.concatenate(rows).astype(np.int64), episode, anchor)


def roads_of(mapping: Mapping) -> Roads | None:
    """The roads that may be laid under the drives; None: they are told against their own."""
    if mapping.pose is None or mapping.follows_line:
        return None
    roads = mapping.pose.roads
    return Roads(roads.curvatures_per_m, roads.ey_m, radians(roads.epsi_deg))
