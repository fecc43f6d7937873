"""Bilinear EDMD: monomials, and inputs multiplied by some of them."""

from itertools import combinations_with_replacement

import made_drives
import numpy as np
import pytest
from made_drives import drive, relative_error

from offline.baselines.bilinear import (
    BilinearSettings,
    GainColumns,
    evaluate_monomials,
    fit_bilinear,
    monomials_of,
    to_bundle,
)
from offline.config import PAST_STEPS
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


def settings_of(*observables, past_steps=(0,), gains=(GainColumns.STATES,), ridges=RIDGES):
    return BilinearSettings(observables, past_steps, ridges, gains)


def test_monomials_fit_a_system_that_is_linear_in_them():
    manifold = drive(slow_manifold_step)
    # 3 states, 10 products of two of (x, w), the constant
    found = fit_bilinear(manifold, settings_of(14))
    assert np.all(relative_error(found, manifold.select("test")) < 1e-3)


def test_products_with_the_inputs_fit_a_bilinear_system():
    made = drive(bilinear_step)
    found = fit_bilinear(made, settings_of(14))
    assert found.dictionary.gains == (0, 1, 2)
    assert found.matrices.gains.follows is Follow.PREDICTION
    assert relative_error(found, made.select("test"))[1] < 1e-4


def test_delays_explain_an_input_that_acts_one_step_late():
    late = drive(late_step)
    found = fit_bilinear(late, settings_of(14, past_steps=(0, 1)))
    assert found.dictionary.past_steps == 1
    assert relative_error(found, late.select("test"))[1] < 1e-3


def test_a_dictionary_of_given_size_has_the_most_relevant_monomials():
    """One of 10 products is part of the system; the dictionary has one product."""
    found = fit_bilinear(drive(slow_manifold_step), settings_of(5))
    assert found.dictionary.monomials.tolist() == [[0, 0]]


def test_the_search_is_repeatable():
    made = drive(bilinear_step)
    settings = settings_of(12, past_steps=(0, 1), gains=tuple(GainColumns))
    one, other = fit_bilinear(made, settings), fit_bilinear(made, settings)
    assert np.array_equal(one.matrices.A, other.matrices.A)
    assert np.array_equal(one.dictionary.monomials, other.dictionary.monomials)


def test_a_dictionary_smaller_than_the_states_is_refused():
    with pytest.raises(DatasetError, match="found none"):
        fit_bilinear(drive(bilinear_step), settings_of(3))


def test_windows_without_enough_past_are_refused():
    made = drive(bilinear_step)
    found = fit_bilinear(made, settings_of(20, past_steps=(2,)))
    windows = made.select("test")
    with pytest.raises(DatasetError, match=r"past \(batch, 2 or more, 3\)"):
        made_drives.predict(found, windows._replace(past=windows.past[:, :1]))


@pytest.mark.parametrize("degree", [2, 3])
def test_monomials_are_all_products_of_their_degree(degree):
    v = np.random.default_rng(0).normal(size=(5, 3))
    found = evaluate_monomials(monomials_of(3, degree), v)
    expected = [
        np.prod(v[:, entries], axis=1)
        for entries in combinations_with_replacement(range(3), degree)
    ]
    assert np.allclose(found, np.stack(expected, axis=1))


def selftest_of(dataset):
    windows = dataset.select("train").take(slice(None, SELFTEST_STATES))
    x, _, w, past = (series.astype(np.float64) for series in windows[:4])
    return LiftSample(x[:, 0], w[:, 0], past)


@pytest.mark.parametrize(
    "settings",
    [
        settings_of(20, past_steps=(2,), gains=(GainColumns.PRODUCTS,), ridges=(1e-6,)),
        settings_of(34, gains=(GainColumns.SPEED,), ridges=(1e-6,)),
        settings_of(20, gains=(GainColumns.STATES,), ridges=(1e-6,)),
    ],
    ids=["products and past", "speed", "states"],
)
def test_the_bundle_predicts_what_the_model_predicts(settings, tmp_path):
    """Up to the float32 precision of the encoder."""
    made = drive(bilinear_step)
    model = fit_bilinear(made, settings)
    bundle = to_bundle("edmd", model, made, selftest_of(made))
    save_bundle(tmp_path, bundle, "card")
    predictor = BundlePredictor(load_bundle(tmp_path))
    assert bundle.parity_error(predictor.lift(bundle.selftest)) < 1e-5
    windows = made.select("test")
    by_bundle, _ = made_drives.predict(predictor, windows)
    by_model, _ = made_drives.predict(model, windows)
    assert np.allclose(by_bundle, by_model, atol=1e-4)


def test_speed_gains_are_the_first_centred_state_and_its_powers(toy_dataset):
    settings = settings_of(80, past_steps=(1,), gains=(GainColumns.SPEED,))
    model = fit_bilinear(toy_dataset, settings)
    windows = toy_dataset.select("test")
    x, w, past = (windows[i].astype(np.float64) for i in (0, 2, 3))
    psi = model.dictionary.lift(x[:, 0], w[:, 0], past)
    assert past.shape[1] == PAST_STEPS
    speed = psi[:, 0]
    powers = np.stack([speed, speed**2, speed**3], axis=1)
    assert np.allclose(psi[:, model.dictionary.gains], powers)
