"""Drives of systems that are known to the last digit, as data sets that are never on disk."""

import numpy as np

from offline.config import PAST_STEPS, STEPS
from offline.data.dataset import Dataset, split_episodes
from offline.data.manifest import Imported, Manifest
from offline.data.recording import Recording, Starts
from offline.data.signals import Roles
from rt_controller.contract.signals import Schema, Signal

SCHEMA = Schema(
    states=(Signal("speed_mps", "m/s"), Signal("level_m", "m"), Signal("swing_rad", "rad")),
    inputs=(Signal("push_n", "N"), Signal("turn_rad", "rad")),
    exogenous=(Signal("slope", "1"),),
    dt_s=0.05,
)
ROLES = Roles(centred=("speed_mps",), odd=None, past=("speed_mps", "swing_rad", "turn_rad"))
SAMPLES = PAST_STEPS + 2 * STEPS + 1
SLICES = 2


def drive(step, episodes=30, seed=0):
    """A data set of x+ = step(x, u, w, u_before), all (E, ...), under smooth random inputs."""
    rng = np.random.default_rng(seed)
    wave = rng.uniform(0.02, 0.15, (episodes, 1, 2)) * np.arange(SAMPLES)[:, None]
    u = np.sin(wave + rng.uniform(0, 6, (episodes, 1, 2))) * rng.uniform(0.3, 1, (episodes, 1, 2))
    w = np.repeat(rng.uniform(-1, 1, (episodes, 1, 1)), SAMPLES, axis=1)
    x = np.empty((episodes, SAMPLES, 3))
    x[:, 0] = rng.uniform(-0.5, 0.5, (episodes, 3))
    for k in range(SAMPLES - 1):
        x[:, k + 1] = step(x[:, k], u[:, k], w[:, k], u[:, max(k - 1, 0)])
    return dataset_of(x, u, w)


def dataset_of(x, u, w, schema=SCHEMA, roles=ROLES):
    """Episodes (E, T, ...) of equal length as a data set without poses."""
    episodes, samples = x.shape[:2]
    first = samples * np.arange(episodes, dtype=np.int64)
    recording = Recording(
        *(part.reshape(-1, part.shape[-1]).astype(np.float32) for part in (x, u, w)),
        pose=np.zeros((0, 3)),
        first=first,
    )
    slices = Starts(
        np.add.outer(first, PAST_STEPS + STEPS * np.arange(SLICES)).ravel(),
        np.repeat(np.arange(episodes, dtype=np.int32), SLICES),
        None,
    )
    manifest = Manifest(
        schema=schema,
        roles=roles,
        roads=None,
        sha256=f"made-{float(np.sum(x)):.12e}",
        trajectories=len(slices.row),
        rejected_episodes=0,
        versions={},
        origin=Imported((), "", episodes, 0),
    )
    return Dataset(recording, slices, split_episodes(episodes, 0), manifest)


def predict(baseline, windows):
    """What the baseline predicts for these trajectories, and what happened, steps 1..K."""
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    return baseline.predict(x[:, 0], past, u, w)[:, 1:], x[:, 1:]


def relative_error(baseline, windows):
    """(n,) root mean square error of each state in its own spread."""
    predicted, happened = predict(baseline, windows)
    spread = happened.reshape(-1, happened.shape[-1]).std(axis=0)
    return np.sqrt(np.square(predicted - happened).mean(axis=(0, 1))) / spread
