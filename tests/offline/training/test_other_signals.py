"""A model of other signals than the car's is trained, exported and evaluated.

Three states, two inputs, nothing exogenous, no poses, drives of unequal length, another period.
"""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from offline.config import PAST_STEPS, PRESETS, STEPS, TrainingConfig
from offline.data.dataset import Dataset, load_dataset, save_dataset
from offline.data.manifest import Imported, SourceFile
from offline.data.recording import Recording, Starts
from offline.data.signals import Roles
from offline.model.bundle_predictor import BundlePredictor
from offline.training.export import export_checkpoint
from offline.training.run import RunFolder, create_run, load_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import Schema, Signal
from rt_controller.model.validation import require_drivable

DT_S = 0.05
BOAT = Schema(
    states=(Signal("v_x", "m/s"), Signal("v_y", "m/s"), Signal("yaw_rate", "rad/s")),
    inputs=(Signal("steering", "rad"), Signal("force", "N")),
    exogenous=(),
    dt_s=DT_S,
)
PAST = ("v_x", "v_y", "yaw_rate", "steering", "force")
SYMMETRICAL = Roles(centred=("v_x",), odd=("v_y", "yaw_rate", "steering"), past=PAST)
LOPSIDED = Roles(centred=("v_x",), odd=None, past=PAST)
EPISODES = 20


def drive(rng: np.random.Generator, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """States (samples, 3) and inputs (samples, 2) of a simple vehicle with drag and yaw."""
    t_s = DT_S * np.arange(samples)
    steering = 0.3 * np.sin(2 * np.pi * 0.2 * t_s + rng.uniform(0, 6))
    force = 500.0 * np.sin(2 * np.pi * 0.1 * t_s + rng.uniform(0, 6))
    x = np.zeros((samples, 3))
    x[0] = rng.uniform(8.0, 12.0), 0.0, 0.0
    for k in range(samples - 1):
        vx, vy, yaw_rate = x[k]
        x[k + 1, 0] = vx + DT_S * (force[k] / 1000.0 - 0.05 * (vx - 10.0))
        x[k + 1, 1] = vy + DT_S * (-2.0 * vy + 0.2 * vx * steering[k])
        x[k + 1, 2] = yaw_rate + DT_S * (-1.5 * yaw_rate + 0.3 * vx * steering[k])
    return x, np.column_stack([steering, force])


def save(folder: Path, roles: Roles) -> Dataset:
    rng = np.random.default_rng(4)
    lengths = rng.integers(PAST_STEPS + STEPS + 1, 300, EPISODES)
    x, u = (np.concatenate(each) for each in zip(*(drive(rng, n) for n in lengths), strict=True))
    first = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    slices = (lengths - 1 - PAST_STEPS) // STEPS
    rows = [f + PAST_STEPS + STEPS * np.arange(n) for f, n in zip(first, slices, strict=True)]
    recording = Recording(
        x.astype(np.float32), u.astype(np.float32), np.zeros((len(x), 0), np.float32),
        np.zeros((0, 3)), first,
    )  # fmt: skip
    save_dataset(
        folder,
        recording,
        Starts(np.concatenate(rows), np.repeat(np.arange(EPISODES, dtype=np.int32), slices), None),
        np.int8([1, 1, 2, 2] + 16 * [0]),
        schema=BOAT,
        roles=roles,
        roads=None,
        origin=Imported((SourceFile("log.csv", "ab" * 32),), "mapping", EPISODES, seed=0),
    )
    return load_dataset(folder)


def a_config() -> TrainingConfig:
    """The preset recommended, reduced to the size of a test."""
    run = {"steps": 100, "learning_rate": 1e-2, "batch": 16, "evaluate_every": 20, "threads": 1}
    ranks = {"history_steps": 3, "bilinear_rank": 2, "drift_rank": 1}
    return PRESETS["recommended"].model_copy(
        update={"hidden": (8, 8), "latents": 4, **run, **ranks}
    )


def a_run(folder: Path, dataset: Dataset) -> RunFolder:
    now = datetime(2026, 1, 2, 3, 4, 5)
    return create_run(folder / "runs", a_config(), folder / "data", dataset.sha256, now)


@pytest.fixture(scope="module", params=[SYMMETRICAL, LOPSIDED], ids=["odd signals", "no mirror"])
def trained(request, tmp_path_factory):
    """Data set, run and training result."""
    folder = tmp_path_factory.mktemp("boat")
    dataset = save(folder / "data", request.param)
    run = a_run(folder, dataset)
    outcome = train(a_config(), dataset, run)
    return dataset, run, outcome


@pytest.fixture(scope="module")
def bundle(trained):
    dataset, run, _ = trained
    exported, _ = export_checkpoint(load_checkpoint(run.best), dataset)
    return exported


def test_training_finishes_and_lowers_the_loss(trained):
    _, run, outcome = trained
    first = load_checkpoint(run.last).validation_losses[0]
    assert outcome.is_finished
    assert outcome.skipped == 0
    assert outcome.best_validation_loss < first - 0.3


def test_the_bundle_contains_the_schema_of_the_data(trained, bundle):
    assert bundle.schema == BOAT
    assert bundle.lift.history_fields == PAST
    assert bundle.A.shape == (7, 7)
    assert bundle.B_uc.shape == (7, 2)
    assert bundle.B_uw.shape == (7, 0)
    assert bundle.selftest.history.shape[1:] == (3, 5)


def test_the_bundle_predicts_better_than_constant_states(trained, bundle):
    dataset, *_ = trained
    test = dataset.select("test")
    x, past, u, w = (each.astype(np.float64) for each in (test.x, test.past, test.u, test.w))
    predicted = BundlePredictor(bundle).predict(x[:, 0], past, u, w)
    assert predicted.shape == x.shape
    assert np.array_equal(predicted[:, 0], x[:, 0])
    errors = np.mean((predicted - x) ** 2, axis=(0, 1))
    standing_still = np.mean((x[:, :1] - x) ** 2, axis=(0, 1))
    assert np.exp(np.mean(np.log(errors / standing_still))) < 1.0


def test_without_past_signals_the_model_is_trained_and_exported_without_history(tmp_path):
    """`history_steps` has no effect if no signal belongs to the history."""
    dataset = save(tmp_path / "data", replace(SYMMETRICAL, past=()))
    run = a_run(tmp_path, dataset)
    train(a_config(), dataset, run)
    bundle, _ = export_checkpoint(load_checkpoint(run.best), dataset)
    assert bundle.lift.history_steps == 0


def test_the_controller_refuses_the_bundle(bundle):
    with pytest.raises(ArtifactError, match="cannot drive this car"):
        require_drivable(bundle)
