"""Bilinear EDMD: monomials, and inputs multiplied by some of them."""

import numpy as np
import pytest
from made_drives import drive, predict, relative_error

from offline.baselines.bilinear import fit_bilinear
from offline.baselines.linear import to_bundle
from offline.model.bundle_predictor import BundlePredictor
from offline.model.physical_units import SELFTEST_STATES
from rt_controller.contract.errors import DatasetError
from rt_controller.model.artifact import load_bundle, save_bundle
from rt_controller.model.follow import Follow
from rt_controller.model.lift import LiftSample

RIDGES = (1e-12, 1e-9, 1e-6)


def slow_manifold_step(x, u, w, u_before):
    """Linear in x and the square of the first state, which has no input."""
    first = 0.97 * x[:, 0]
    second = 0.9 * x[:, 1] + 0.3 * x[:, 0] ** 2 + 0.1 * u[:, 1] + 0.05 * w[:, 0]
    return np.stack([first, second, 0.95 * x[:, 2] + 0.02 * w[:, 0]], axis=1)


def bilinear_step(x, u, w, u_before):
    """The effect of the second input grows with the first state, which has no input."""
    turned = 0.95 * x[:, 1] + (0.02 + 0.2 * x[:, 0]) * u[:, 1] + 0.05 * u[:, 0]
    return np.stack([0.98 * x[:, 0] + 0.02 * w[:, 0], turned, 0.9 * x[:, 2]], axis=1)


def late_step(x, u, w, u_before):
    """The second input acts one step late."""
    return 0.95 * x + 0.1 * np.stack([x[:, 2], u_before[:, 1], u[:, 0]], axis=1)


@pytest.mark.parametrize(
    ("step", "past_steps", "accuracy"),
    [(slow_manifold_step, 0, 1e-3), (bilinear_step, 0, 1e-4), (late_step, 1, 1e-3)],
    ids=["linear in monomials", "bilinear", "late input"],
)
def test_a_system_of_its_form_is_fitted(step, past_steps, accuracy):
    """3 states, 10 products of two of (x, w), the constant; with one row of the past or without."""
    made = drive(step)
    found = fit_bilinear(made, (14,), (0, 1) if past_steps else (0,), RIDGES)
    assert found.past_steps == past_steps
    assert found.matrices.gains.follows is Follow.PREDICTION
    assert relative_error(found, made.select("test"))[1] < accuracy


def test_a_dictionary_of_given_size_has_the_most_relevant_monomials():
    """One of 10 products is part of the system; the dictionary has one product."""
    found = fit_bilinear(drive(slow_manifold_step), (5,), (0,), RIDGES)
    assert found.dictionary.monomials.tolist() == [[0, 0]]


def test_a_dictionary_smaller_than_the_states_is_refused():
    with pytest.raises(DatasetError, match="found none"):
        fit_bilinear(drive(bilinear_step), (3,), (0,))


@pytest.mark.parametrize(("size", "past_steps"), [(20, 2), (34, 0)])
def test_the_bundle_predicts_what_the_model_predicts(size, past_steps, tmp_path):
    """Up to the float32 precision of the encoder."""
    made = drive(bilinear_step)
    model = fit_bilinear(made, (size,), (past_steps,), (1e-6,))
    windows = made.select("train").take(slice(None, SELFTEST_STATES))
    x, _, w, past = (series.astype(np.float64) for series in windows[:4])
    bundle = to_bundle("edmd", model, made, LiftSample(x[:, 0], w[:, 0], past))
    save_bundle(tmp_path, bundle, "card")
    predictor = BundlePredictor(load_bundle(tmp_path))
    assert bundle.parity_error(predictor.lift(bundle.selftest)) < 1e-5
    by_bundle, _ = predict(predictor, made.select("test"))
    by_model, _ = predict(model, made.select("test"))
    assert np.allclose(by_bundle, by_model, atol=1e-4)
