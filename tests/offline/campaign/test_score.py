"""A model is scored beside the fair linear one, on the validation part, in every state."""

import numpy as np
import pytest

from offline.baselines.lti import fit_linear
from offline.campaign import score as score_module
from offline.campaign.data import fair_linear_errors
from offline.campaign.score import assess, mean_squared_errors, score
from offline.checkpoint import load_checkpoint
from offline.export import make_bundle
from offline.predictor import BundlePredictor
from offline.train import train


class Shifted:
    """Predicts the truth, off by a constant in each state."""

    def __init__(self, truth, off):
        self.truth, self.off, self.next = truth, np.asarray(off), 0

    def predict(self, x0, past, U, W):
        rows = slice(self.next, self.next + len(x0))
        self.next += len(x0)
        return self.truth[rows] + self.off


def test_errors_are_mean_squares_over_steps_and_trajectories(toy_dataset, monkeypatch):
    monkeypatch.setattr(score_module, "CHUNK", 7)
    validation = toy_dataset.select("validation")
    off = np.array([1.0, 2.0, 0.5, 0.0, 3.0, 0.1])
    model = Shifted(validation.x.astype(np.float64), off)
    assert mean_squared_errors(model, validation) == pytest.approx(off**2, abs=1e-12)


def test_a_prediction_that_is_no_number_counts_as_infinitely_wrong(toy_dataset):
    validation = toy_dataset.select("validation")
    model = Shifted(validation.x.astype(np.float64), [np.nan, 0.0, np.inf, 0.0, 0.0, 1.0])
    errors = mean_squared_errors(model, validation)
    assert np.isinf(errors[[0, 2]]).all()
    assert np.isfinite(errors[[1, 3, 4, 5]]).all()


def test_a_score_says_how_many_times_less_the_error_is():
    found = score(np.array([1.0, 2.0, 8.0]), np.array([2.0, 2.0, 4.0]))
    assert found.ratios == (2.0, 1.0, 0.5)
    assert found.geometric_mean == pytest.approx(1.0)


def test_a_state_that_is_infinitely_wrong_leaves_no_geometric_mean():
    assert score(np.array([1.0, np.inf]), np.array([2.0, 2.0])).geometric_mean == 0.0


def test_the_fair_linear_model_is_at_least_as_good_as_plain_least_squares(
    toy_dataset, monkeypatch, tmp_path
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    validation = toy_dataset.select("validation")
    plain = mean_squared_errors(fit_linear(toy_dataset), validation)
    assert np.all(fair_linear_errors(toy_dataset) <= plain * (1 + 1e-9))


ENCODER = (8 * 8 + 8) + (8 * 3 + 3)
"""of both, behind the first layer: one of the four latents is the constant"""
LINEAR = 9 * 10 + 9 * 4
"""A and B, without the constant's row"""
BILINEAR = 2 * 9 * 3 + 2 * 3 * 10
"""N and S of rank 2"""
PRODUCTS = (7 * 8 // 2) * 3
"""of every two of the six states and the curvature, for each latent"""


@pytest.mark.parametrize(
    ("fixture", "n_parameters"),
    [
        ("tiny_config", (6 * 8 + 8) + ENCODER + LINEAR),
        # shown the state, three rows of history, and the curvature
        ("tiny_recommended", ((6 + 3 * 6 + 1) * 8 + 8) + ENCODER + LINEAR + BILINEAR + PRODUCTS),
    ],
)
def test_a_checkpoint_scores_as_the_bundle_that_is_made_of_it(
    fixture, n_parameters, request, toy_dataset, new_run, monkeypatch
):
    monkeypatch.setattr(score_module, "CHUNK", 7)
    config = request.getfixturevalue(fixture)
    run = new_run(config)
    train(config, toy_dataset, run)
    checkpoint = load_checkpoint(run.best)
    bundle, gate = make_bundle(checkpoint, toy_dataset)
    exported = mean_squared_errors(BundlePredictor(bundle), toy_dataset.select("validation"))
    found = assess(checkpoint, toy_dataset)
    assert found.errors == pytest.approx(exported, rel=1e-4)
    assert found.n_parameters == n_parameters
    assert found.spectral_radius == pytest.approx(gate.spectral_radius, abs=1e-6)
