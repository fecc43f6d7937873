"""Logs become a data set, a model is trained on it, exported and evaluated.

Three states, two inputs, nothing exogenous, no poses, drives of unequal length, another period.
"""

import numpy as np
import pytest
from made_logs import MAPPING, change_log, columns_of, make_place, run_import, write_csv

from offline.config import PRESETS, TrainingConfig
from offline.data.dataset import Dataset, load_dataset
from offline.model.bundle_predictor import BundlePredictor
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError
from rt_controller.model.validation import require_drivable

SYMMETRICAL = '[roles]\nodd = ["vy_mps", "yaw_rate_radps", "road_wheel_rad"]\n'


def imported(folder, roles) -> Dataset:
    """Ten drives of the made car, of which one is shorter."""
    place = make_place(folder)
    for seed in range(3, 9):
        change_log(place, seed)
    short = {name: values[:900] for name, values in columns_of(9).items()}
    write_csv(place / "logs" / "short.csv", short)
    (place / "map.toml").write_text(f"period_s = 0.05\n{MAPPING}{roles}")
    assert run_import(place, "--data", place / "data") == 0
    return load_dataset(place / "data")


def a_config() -> TrainingConfig:
    """The preset recommended, reduced to the size of a test."""
    run = {"steps": 100, "learning_rate": 1e-2, "batch": 16, "evaluate_every": 20, "threads": 1}
    ranks = {"history_steps": 3, "bilinear_rank": 2, "drift_rank": 1}
    small = {"hidden": (8, 8), "latents": 4, "weight_stability": 200.0, **run, **ranks}
    return PRESETS["recommended"].model_copy(update=small)


@pytest.fixture(scope="module", params=[SYMMETRICAL, ""], ids=["odd signals", "no mirror"])
def trained(request, tmp_path_factory, new_run):
    """Data set, run and training result."""
    dataset, run = imported(tmp_path_factory.mktemp("logs"), request.param), new_run(a_config())
    return dataset, run, train(run.config, dataset, run)


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
    assert bundle.schema == trained[0].schema
    assert bundle.lift.history_fields == (
        "vx_mps",
        "vy_mps",
        "yaw_rate_radps",
        "road_wheel_rad",
        "force_n",
    )
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


def test_without_past_signals_the_model_is_trained_and_exported_without_history(
    tmp_path_factory, new_run
):
    """`history_steps` has no effect if no signal belongs to the history."""
    dataset = imported(tmp_path_factory.mktemp("logs"), "[roles]\npast = []\n")
    run = new_run(a_config())
    train(run.config, dataset, run)
    bundle, _ = export_checkpoint(load_checkpoint(run.best), dataset)
    assert bundle.lift.history_steps == 0


def test_the_controller_refuses_the_bundle(bundle):
    with pytest.raises(ArtifactError, match="cannot drive this car"):
        require_drivable(bundle)
