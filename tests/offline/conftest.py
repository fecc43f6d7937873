"""A toy car whose episodes are simulated in milliseconds."""

import shutil
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from offline.config import PRESETS, TrainingConfig
from offline.data.dataset import Dataset, load_dataset, save_dataset, split_episodes
from offline.data.generate import EPISODE_STEPS, SLICES, Episode, Generated, assemble
from offline.data.manifest import Roads, Simulated
from offline.data.recipe import Recipe
from offline.data.signals import VEHICLE_ROLES
from offline.training.run import RunFolder, create_run, open_run
from offline.training.train import train
from rt_controller.contract.signals import VEHICLE

EPISODES = 40
CURVATURES = (-4e-3, 0.0, 4e-3)
DT_S = 0.025


def toy_drives(episodes: int = EPISODES) -> Generated:
    """A point with drag and first-order yaw on a plane; five slices per episode."""
    rng = np.random.default_rng(7)
    steps = EPISODE_STEPS
    u = np.zeros((steps, episodes, 3))
    u[:, :, 0] = rng.uniform(0.0, 1.0, episodes)
    u[:, : episodes // 4, :2] = [0.0, 30.0]
    phase = rng.uniform(0.0, 2 * np.pi, episodes)
    u[:, :, 2] = 0.4 * np.sin(2 * np.pi * 0.5 * DT_S * np.arange(steps)[:, None] + phase)
    motion, pose = np.zeros((steps + 1, episodes, 3)), np.zeros((steps + 1, episodes, 3))
    vx, yaw_rate, yaw = 22 + 6 * rng.uniform(-1, 1, episodes), np.zeros(episodes), 0.0
    X = Y = np.zeros(episodes)
    for k in range(steps + 1):
        motion[k] = np.stack([vx, 0.3 * yaw_rate, yaw_rate], axis=1)
        pose[k] = np.stack([X, Y, yaw + np.zeros(episodes)], axis=1)
        if k < steps:
            X, Y = X + DT_S * vx * np.cos(yaw), Y + DT_S * vx * np.sin(yaw)
            yaw = yaw + DT_S * yaw_rate
            wanted = u[k, :, 2] * vx / (55.0 + 0.05 * vx**2)
            yaw_rate = yaw_rate + 0.2 * (wanted - yaw_rate)
            vx = vx + DT_S * (3 * u[k, :, 0] - 0.05 * u[k, :, 1] - 4e-4 * vx**2)
    errors = rng.uniform(-1, 1, (episodes, SLICES, 2)) * (2.0, 0.15)
    curvature = rng.choice(CURVATURES, episodes)
    return assemble(
        [
            Episode(motion[:, e], pose[:, e], u[:, e], float(curvature[e]), errors[e], int(e < 10))
            for e in range(episodes)
        ]
    )


def save_toy(folder: Path, drives: Generated, episodes: int = EPISODES) -> Dataset:
    """The episodes as a data set of seed 3 with ten rejected episodes."""
    return save_dataset(
        folder,
        drives.recording,
        drives.slices,
        split_episodes(episodes, 3),
        schema=VEHICLE,
        roles=VEHICLE_ROLES,
        roads=Roads(CURVATURES, 2.0, 0.15),
        origin=Simulated(Recipe(curvatures_per_m=CURVATURES), episodes, 3, "toy"),
        rejected=drives.rejected,
    )


@pytest.fixture(scope="session")
def toy_folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("toy") / "data"
    save_toy(folder, toy_drives())
    return folder


@pytest.fixture(scope="session")
def toy_dataset(toy_folder) -> Dataset:
    return load_dataset(toy_folder)


SMALL = {
    "steps": 12,
    "batch": 16,
    "evaluate_every": 5,
    "hidden": (8, 8),
    "latents": 4,
    "threads": 1,
}
WITH_GAINS = {"history_steps": 3, "bilinear_rank": 2, "drift_rank": 1}


@pytest.fixture(scope="session")
def tiny_config() -> TrainingConfig:
    """The preset paper, reduced to the size of a test."""
    return PRESETS["paper"].model_copy(update=SMALL)


@pytest.fixture(scope="session")
def tiny_recommended() -> TrainingConfig:
    """The preset recommended, reduced to the size of a test."""
    return PRESETS["recommended"].model_copy(update={**SMALL, **WITH_GAINS})


@pytest.fixture(scope="session", params=["paper", "recommended"])
def config(request, tiny_config, tiny_recommended) -> TrainingConfig:
    return {"paper": tiny_config, "recommended": tiny_recommended}[request.param]


@pytest.fixture(scope="session")
def new_run(toy_folder, toy_dataset, tmp_path_factory):
    """Function that makes the folder of a run on the toy data set, in a folder of its own."""

    def create(config: TrainingConfig) -> RunFolder:
        base, now = tmp_path_factory.mktemp("runs"), datetime(2026, 1, 2, 3, 4, 5)
        return create_run(base, config, toy_folder, toy_dataset.sha256, now)

    return create


@pytest.fixture(scope="session")
def finished(config, toy_dataset, new_run) -> RunFolder:
    """A finished run, which no test may change."""
    run = new_run(config)
    train(config, toy_dataset, run)
    return run


@pytest.fixture
def copied(finished, tmp_path) -> RunFolder:
    """A copy of the finished run, to damage."""
    return open_run(shutil.copytree(finished.path, tmp_path / "copy"))
