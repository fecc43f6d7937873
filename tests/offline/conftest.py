"""A toy car whose two-second trajectories are made in milliseconds."""

from pathlib import Path

import numpy as np
import pytest

from offline.config import PRESETS, TrainingConfig
from offline.dataset import Dataset, Trajectories, load_dataset, save_dataset
from offline.excitation import Recipe
from offline.manifest import Origin

EPISODES = 40
CURVATURES = (-4e-3, 0.0, 4e-3)
DT_S = 0.025


def toy_trajectories(episodes: int = EPISODES) -> Trajectories:
    """A point with drag, first-order yaw and the road's kinematics; five slices an episode."""
    rng = np.random.default_rng(7)
    n, steps = 5 * episodes, 80
    u = np.zeros((n, steps, 3))
    u[:, :, 0] = rng.uniform(0.0, 1.0, (n, 1))
    u[: n // 4, :, :2] = [0.0, 60.0]
    phase = rng.uniform(0.0, 2 * np.pi, (n, 1))
    u[:, :, 2] = 0.4 * np.sin(2 * np.pi * 0.5 * DT_S * np.arange(steps) + phase)
    kappa = np.repeat(rng.choice(CURVATURES, episodes), 5)
    x = np.zeros((n, steps + 1, 6))
    vx, ey, epsi = (rng.uniform(-1, 1, n) for _ in range(3))
    vx, ey, epsi = 20 + 8 * vx, 2 * ey, 0.15 * epsi
    yaw_rate = np.zeros(n)
    ds = DT_S * vx
    for k in range(steps + 1):
        x[:, k] = np.stack([vx, 0.3 * yaw_rate, yaw_rate, ds, ey, epsi], axis=1)
        if k < steps:
            ds = DT_S * vx * np.cos(epsi) / (1 - kappa * ey)
            ey = ey + DT_S * vx * np.sin(epsi)
            epsi = epsi + DT_S * yaw_rate - kappa * ds
            wanted = u[:, k, 2] * vx / (55.0 + 0.05 * vx**2)
            yaw_rate = yaw_rate + 0.2 * (wanted - yaw_rate)
            vx = vx + DT_S * (3 * u[:, k, 0] - 0.05 * u[:, k, 1] - 4e-4 * vx**2)
    return Trajectories(
        x.astype(np.float32),
        u.astype(np.float32),
        kappa.astype(np.float32),
        np.repeat(np.arange(episodes, dtype=np.int32), 5),
    )


@pytest.fixture(scope="session")
def toy_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("toy") / "data"
    save_dataset(
        folder,
        toy_trajectories(),
        rejected=10,
        origin=Origin(Recipe(curvatures_per_m=CURVATURES), EPISODES, 3, "toy"),
    )
    return folder


@pytest.fixture(scope="session")
def toy_dataset(toy_folder) -> Dataset:
    return load_dataset(toy_folder)


@pytest.fixture
def tiny_config() -> TrainingConfig:
    """Small enough for a test, with everything that a real run has."""
    return PRESETS["paper"].model_copy(
        update={
            "steps": 12,
            "batch": 16,
            "evaluate_every": 5,
            "hidden": (8, 8),
            "latents": 4,
            "target_samples": 6,
            "threads": 1,
        }
    )
