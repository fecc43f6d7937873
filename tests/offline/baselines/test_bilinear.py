"""Models that are linear or bilinear in a fixed dictionary."""

from dataclasses import replace
from itertools import combinations_with_replacement

import made_drives
import numpy as np
import pytest
from made_drives import drive, relative_error

from offline.baselines.dictionary.bundle import to_bundle
from offline.baselines.dictionary.functions import Family, cosines, gaussians, monomials
from offline.baselines.dictionary.search import EdmdSettings, Gains, fit_edmd
from offline.config import PAST_STEPS
from offline.model.bundle_export import SELFTEST_STATES
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.model.artifact import load_bundle, save_bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.model.lift import LiftSample

RIDGES = (1e-12, 1e-9, 1e-6)


def delayed_step(x, u, w, u_before):
    """The input of the step before acts, and the present one does not."""
    return 0.95 * x + np.stack([0.1 * u_before[:, 0], 0.1 * u_before[:, 1], 0.05 * x[:, 0]], axis=1)


def slow_manifold_step(x, u, w, u_before):
    """Linear in x and the square of the first state, which has no input."""
    first = 0.97 * x[:, 0]
    second = 0.9 * x[:, 1] + 0.3 * x[:, 0] ** 2 + 0.1 * u[:, 1] + 0.05 * w[:, 0]
    return np.stack([first, second, 0.95 * x[:, 2] + 0.02 * w[:, 0]], axis=1)


def bilinear_step(x, u, w, u_before):
    """The effect of the second input grows with the first state, which has no input."""
    turned = 0.95 * x[:, 1] + (0.02 + 0.2 * x[:, 0]) * u[:, 1] + 0.05 * u[:, 0]
    return np.stack([0.98 * x[:, 0] + 0.02 * w[:, 0], turned, 0.9 * x[:, 2]], axis=1)


def settings_of(family, **changes):
    return EdmdSettings(family, ridges=RIDGES, **changes)


def test_delays_explain_an_input_that_acts_one_step_late():
    """The past has the second input but not the first: only the level can be predicted."""
    late = drive(delayed_step)
    test = late.select("test")
    found = fit_edmd(late, settings_of(Family.NONE, past_steps=(0, 1)))
    error = relative_error(found, test)
    assert found.dictionary.past_steps == 1
    assert error[1] < 1e-4
    assert error[0] > 1e-3


def test_without_delays_or_functions_the_dictionary_is_the_linear_model(toy_dataset):
    found = fit_edmd(toy_dataset, settings_of(Family.NONE, past_steps=(0,)))
    assert len(found.matrices.A) == 7
    assert np.allclose(found.matrices.A[-1], np.eye(7)[-1])


def test_monomials_fit_a_system_that_is_linear_in_them():
    manifold = drive(slow_manifold_step)
    # 3 states, 10 products of two of (x, w), the constant
    found = fit_edmd(manifold, settings_of(Family.MONOMIALS, observables=(14,), past_steps=(0,)))
    assert np.all(relative_error(found, manifold.select("test")) < 1e-4)


@pytest.mark.parametrize("follow", Follow)
def test_products_with_the_inputs_fit_a_bilinear_system(follow):
    """The gain has no input, so the free response is as good as the prediction."""
    made = drive(bilinear_step)
    settings = settings_of(
        Family.MONOMIALS,
        observables=(14,),
        past_steps=(0,),
        gains=(Gains.STATES,),
        follows=(follow,),
    )
    found = fit_edmd(made, settings)
    error = relative_error(found, made.select("test"))
    assert found.dictionary.gains == (0, 1, 2)
    assert error[1] > 0.05 if follow is Follow.START else error[1] < 1e-4


def test_what_the_gains_follow_is_chosen_on_the_validation_part():
    settings = settings_of(
        Family.MONOMIALS,
        observables=(14,),
        past_steps=(0,),
        gains=(Gains.NONE, Gains.STATES),
        follows=(Follow.START, Follow.FREE_RESPONSE),
    )
    found = fit_edmd(drive(bilinear_step), settings)
    assert (found.matrices.bilinear.follows, found.matrices.bilinear.rank) == (
        Follow.FREE_RESPONSE,
        3,
    )


@pytest.mark.parametrize("family", [Family.GAUSSIANS, Family.COSINES])
def test_other_functions_have_smaller_errors_than_a_linear_model(family):
    manifold = drive(slow_manifold_step)
    test = manifold.select("test")
    linear = fit_edmd(manifold, settings_of(Family.NONE, past_steps=(0,)))
    found = fit_edmd(
        manifold, settings_of(family, observables=(30,), past_steps=(0,), widths=(2.0, 4.0))
    )
    assert len(found.matrices.A) == 30
    assert relative_error(found, test)[1] < 0.3 * relative_error(linear, test)[1]


def test_a_dictionary_of_given_size_has_the_most_relevant_monomials():
    """One of 10 products is part of the system; the dictionary has one product."""
    manifold = drive(slow_manifold_step)
    found = fit_edmd(manifold, settings_of(Family.MONOMIALS, observables=(5,), past_steps=(0,)))
    assert found.dictionary.functions.rows.tolist() == [[0, 0]]


def test_the_search_is_repeatable():
    made = drive(bilinear_step)
    settings = settings_of(Family.GAUSSIANS, observables=(12,), past_steps=(0, 1))
    one, other = fit_edmd(made, settings), fit_edmd(made, settings)
    assert np.array_equal(one.matrices.A, other.matrices.A)
    assert np.array_equal(one.dictionary.functions.rows, other.dictionary.functions.rows)


def test_a_dictionary_smaller_than_the_states_is_refused():
    with pytest.raises(DatasetError, match="monomials"):
        fit_edmd(drive(bilinear_step), settings_of(Family.MONOMIALS, observables=(3,)))


def test_windows_without_enough_past_are_refused():
    made = drive(delayed_step)
    found = fit_edmd(made, settings_of(Family.NONE, past_steps=(2,)))
    windows = made.select("test")
    with pytest.raises(DatasetError, match=r"past \(batch, 2 or more, 3\)"):
        made_drives.predict(found, windows._replace(past=windows.past[:, :1]))


def test_monomials_are_all_products_of_their_degree():
    v = np.random.default_rng(0).normal(size=(5, 3))
    found = monomials(3, range(2, 4)).evaluate(v)
    expected = [
        np.prod(v[:, entries], axis=1)
        for degree in (2, 3)
        for entries in combinations_with_replacement(range(3), degree)
    ]
    assert np.allclose(found, np.stack(expected, axis=1))


def test_a_gaussian_is_one_at_its_centre_and_decreases_with_the_squared_distance():
    v = np.random.default_rng(0).normal(size=(500, 2))
    functions = gaussians(v, 4, 1.5, seed=0)
    at_centres = functions.evaluate(functions.rows)
    assert np.allclose(np.diag(at_centres), 1.0)
    apart = functions.rows[0] - functions.rows[1]
    assert at_centres[0, 1] == pytest.approx(np.exp(-apart @ apart / (2 * functions.width**2)))


def test_products_of_cosines_approximate_a_gaussian_kernel():
    """2/F times the product of two rows tends to exp(-|a - b|^2 / (2 length^2))."""
    a, b = np.array([0.3, -0.2]), np.array([-0.5, 0.4])
    functions = cosines(2, 20_000, 0.8, seed=0)
    kernel = 2.0 * np.mean(functions.evaluate(a) * functions.evaluate(b))
    assert kernel == pytest.approx(np.exp(-1.0 / (2 * 0.64)), abs=0.02)


def selftest_of(dataset):
    windows = dataset.select("train").take(slice(None, SELFTEST_STATES))
    x, _, w, past = (series.astype(np.float64) for series in windows[:4])
    return LiftSample(x[:, 0], w[:, 0], past)


def dictionary(family, *size, **choices):
    return settings_of(family, observables=size, **choices)


@pytest.mark.parametrize(
    "settings",
    {
        "delays": settings_of(Family.NONE, past_steps=(3,)),
        "monomials, frozen": dictionary(
            Family.MONOMIALS, 20, past_steps=(2,), gains=(Gains.PRODUCTS,)
        ),
        "monomials, following the free response": dictionary(
            Family.MONOMIALS,
            34,
            past_steps=(0,),
            gains=(Gains.SPEED,),
            follows=(Follow.FREE_RESPONSE,),
        ),
        "monomials, following the prediction": dictionary(
            Family.MONOMIALS,
            20,
            past_steps=(0,),
            gains=(Gains.STATES,),
            follows=(Follow.PREDICTION,),
        ),
        "gaussians": dictionary(Family.GAUSSIANS, 20, past_steps=(1,), widths=(2.0,)),
        "cosines": dictionary(Family.COSINES, 20, past_steps=(0,), widths=(6.0,)),
    }.values(),
    ids=lambda settings: f"{settings.family}, {settings.follows[0]}",
)
def test_the_bundle_of_a_dictionary_predicts_what_the_model_predicts(settings, tmp_path):
    """Up to the float32 precision of the encoder."""
    made = drive(bilinear_step)
    model = fit_edmd(made, replace(settings, ridges=(1e-6,)))
    bundle = to_bundle("edmd", model, made, selftest_of(made))
    save_bundle(tmp_path, bundle, "card")
    predictor = BundlePredictor(load_bundle(tmp_path))
    assert bundle.parity_error(predictor.lift(bundle.selftest)) < 1e-5
    windows = made.select("test")
    by_bundle, _ = made_drives.predict(predictor, windows)
    by_model, _ = made_drives.predict(model, windows)
    assert np.allclose(by_bundle, by_model, atol=1e-4)


def test_speed_gains_are_the_first_centred_state_and_its_powers(toy_dataset):
    settings = settings_of(
        Family.MONOMIALS, observables=(80,), past_steps=(1,), gains=(Gains.SPEED,)
    )
    model = fit_edmd(toy_dataset, settings)
    windows = toy_dataset.select("test")
    x, w, past = (windows[i].astype(np.float64) for i in (0, 2, 3))
    psi = model.dictionary.lift(x[:, 0], w[:, 0], past)
    assert past.shape[1] == PAST_STEPS
    speed = psi[:, 0]
    powers = np.stack([speed, speed**2, speed**3], axis=1)
    assert np.allclose(psi[:, model.dictionary.gains], powers)
