"""Errors of a model are compared with those of the fair linear model on the validation part."""

from pathlib import Path

import numpy as np
import pytest
from fitted_network import fitted

from offline.baselines.linear import fit_linear
from offline.evaluation import predictor
from offline.experiments import training_task
from offline.experiments.training_task import (
    CampaignData,
    checkpoint_mse,
    geometric_mean,
    mean_squared_errors,
)
from offline.model.bundle_predictor import BundlePredictor
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint
from offline.training.train import train


class ShiftedTruth:
    """Predicts the true states plus a constant in each state."""

    def __init__(self, truth, shift):
        self.truth, self.shift, self.next = truth, np.asarray(shift), 0

    def predict(self, x0, past, U, W):
        rows = slice(self.next, self.next + len(x0))
        self.next += len(x0)
        return self.truth[rows] + self.shift


def test_errors_are_mean_squares_over_steps_and_trajectories(toy_dataset, monkeypatch):
    monkeypatch.setattr(predictor, "_BATCH", 7)
    shift = np.array([1.0, 2.0, 0.5, 0.0, 3.0, 0.1])
    model = ShiftedTruth(toy_dataset.select("validation").x.astype(np.float64), shift)
    assert mean_squared_errors(model, toy_dataset) == pytest.approx(shift**2, abs=1e-12)


def test_error_of_a_prediction_that_is_not_finite_is_infinite(toy_dataset):
    truth = toy_dataset.select("validation").x.astype(np.float64)
    model = ShiftedTruth(truth, [np.nan, 0.0, np.inf, 0.0, 0.0, 1.0])
    errors = mean_squared_errors(model, toy_dataset)
    assert np.isinf(errors[[0, 2]]).all()
    assert np.isfinite(errors[[1, 3, 4, 5]]).all()


def test_ratio_is_the_error_of_the_linear_model_over_that_of_the_model():
    data = CampaignData(Path("data"), "0" * 64, {"vx_mps": 2.0, "vy_mps": 2.0, "ey_m": 4.0})
    found = data.ratios(np.array([1.0, 2.0, 8.0]))
    assert found == {"vx_mps": 2.0, "vy_mps": 1.0, "ey_m": 0.5}
    assert geometric_mean(found.values()) == pytest.approx(1.0)


def test_geometric_mean_is_zero_if_the_error_of_a_state_is_infinite():
    data = CampaignData(Path("data"), "0" * 64, {"vx_mps": 2.0, "ey_m": 2.0})
    assert geometric_mean(data.ratios(np.array([1.0, np.inf])).values()) == 0.0


def test_fair_linear_model_is_at_least_as_good_as_least_squares(shared, toy_dataset):
    plain = mean_squared_errors(fit_linear(toy_dataset), toy_dataset)
    assert list(shared.linear_mse) == list(toy_dataset.schema.state_names)
    assert np.all(np.array([*shared.linear_mse.values()]) <= plain * (1 + 1e-9))


def test_checkpoint_has_the_errors_of_the_bundle_that_is_exported_from_it(
    tiny_recommended, toy_dataset, new_run, monkeypatch
):
    monkeypatch.setattr(training_task, "CHUNK", 7)
    run = new_run(tiny_recommended)
    train(tiny_recommended, toy_dataset, run)
    checkpoint = fitted(load_checkpoint(run.best), toy_dataset)
    bundle, _ = export_checkpoint(checkpoint, toy_dataset)
    exported = mean_squared_errors(BundlePredictor(bundle), toy_dataset)
    assert checkpoint_mse(checkpoint, toy_dataset) == pytest.approx(exported, rel=1e-4)
