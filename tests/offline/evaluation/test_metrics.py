"""Prediction errors in the units of the paper's Table I, with intervals by whole episodes."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation.bootstrap import estimate, mean_draws
from offline.evaluation.comparison import compare_models
from offline.evaluation.metrics import (
    MEANS,
    errors_on,
    ratios_of,
    state_units,
)
from rt_controller.contract.signals import VEHICLE, Schema, Signal

CAR = state_units(VEHICLE)


def figures_of(model, test, schema=VEHICLE):
    """Figures of the library, of a model on this test set."""
    return compare_models({"m": model}, {}, [test], schema).library


def values(by_state, part="value"):
    return [each[part] for each in by_state.values()]


def test_errors_are_in_the_squared_units_of_the_papers_table():
    """Errors of 1 m/s, 1 rad/s, 1 m and 1 rad everywhere; the first state does not count."""
    made = made_trajectories(10)
    error = np.tile([1.0, -1.0, 1.0, 1.0, -1.0, 1.0], (10, 81, 1))
    error[:, 0] = 1e6
    model = WithError(made, error)
    found = figures_of(model, made_test_set(made))["models"]["m"]
    degrees = np.degrees(1.0) ** 2
    assert np.allclose(values(found["mse"]), [12.96, 12.96, degrees, 1.0, 1.0, degrees])
    assert np.allclose(values(found["rms"]), np.sqrt(values(found["mse"])))


def test_rms_error_is_given_for_each_step():
    """An error of k metres at step k."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[..., 4] = np.arange(81)
    by_step = figures_of(WithError(made, error), made_test_set(made))["by_step"]["m"]["rms"]
    assert np.allclose(by_step["ey_m"]["value"], np.arange(1, 81))
    assert np.allclose(by_step["ey_m"]["low"], np.arange(1, 81))
    assert by_step["vx_kmh"]["value"] == [0.0] * 80


def test_pooled_errors_are_the_mean_of_those_on_each_road():
    made = made_trajectories(40)
    test = made_test_set(made, np.repeat([-1e-3, 0.0], [30, 10]))
    found = figures_of(with_random_error(made), test)["models"]["m"]
    right, straight = map(np.array, map(values, found["mse_by_curvature_per_m"].values()))
    assert np.allclose(0.75 * right + 0.25 * straight, values(found["mse"]))
    assert not np.allclose(right, straight)


def test_diverging_predictions_have_infinite_errors_and_are_counted():
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, 40:, 0] = np.inf
    error[4, 40:, 0] = np.nan
    error[5, :, 1] = 1e200  # finite, but not its square
    found = figures_of(WithError(made, error), made_test_set(made))
    model = found["models"]["m"]
    assert model["trajectories_without_finite_prediction"] == 2
    assert np.isinf(values(model["mse"])).tolist() == [True, True, False, False, False, False]
    by_step = np.array(found["by_step"]["m"]["rms"]["vx_kmh"]["value"])
    assert np.all(by_step[:39] == 0.0)
    assert np.all(np.isinf(by_step[39:]))


def test_a_model_gets_the_inputs_curvature_and_past_of_each_trajectory():
    made = made_trajectories(3)
    seen = {}

    class Watching:
        def predict(self, x0, past, U, W):
            seen.update(x0=x0, past=past, U=U, W=W)
            return made.x.astype(float)

    errors_on(Watching(), made_test_set(made), CAR)
    assert np.array_equal(seen["x0"], made.x[:, 0])
    for name, array in (("past", made.past), ("U", made.u), ("W", made.w)):
        assert np.array_equal(seen[name], array)
        assert seen[name].dtype == np.float64


def units_of(*states):
    return state_units(Schema(tuple(Signal(*state) for state in states), (), (), 0.1))


@pytest.mark.parametrize(
    ("state", "name", "unit", "key"),
    [
        (("temperature_k", "K"), "temperature", "K", "temperature_k"),
        (("ax_mps2", "m/s^2"), "ax", "m/s^2", "ax_mps2"),
        (("curvature_per_m", "1/m"), "curvature", "1/m", "curvature_per_m"),
        (("gear", "1"), "gear", "1", "gear"),
        (("charge", ""), "charge", "", "charge"),
        (("speed", "m/s"), "speed", "km/h", "speed_kmh"),
    ],
)
def test_other_states_keep_their_unit_unless_it_is_m_per_s_or_rad(state, name, unit, key):
    (column,) = units_of(state)
    assert (column.name, column.unit, column.key) == (name, unit, key)


def draws(*values, count=5):
    return np.tile(np.array(values, dtype=float), (count, 1))


def means(found):
    return [found[name]["value"] for name in MEANS if name in found]


def test_the_second_mean_leaves_out_progress():
    """Progress, the fourth state, has the only error."""
    one = draws(1, 1, 1, 1, 1, 1)
    assert means(ratios_of(draws(1, 1, 1, 64, 1, 1), one, CAR)) == pytest.approx([2.0, 1.0])
    assert means(ratios_of(draws(32, 1, 1, 64, 1, 1), one, CAR))[1] == pytest.approx(2.0)


def mean_of(values, episode):
    return estimate(mean_draws(np.asarray(values), np.asarray(episode)))


def test_the_mean_is_over_all_values_and_not_over_episode_means():
    assert mean_of([1.0, 2.0, 9.0], [0, 0, 1]).value == pytest.approx(4.0)


def test_intervals_cover_the_true_mean_of_correlated_slices_as_often_as_stated():
    """Slices of an episode differ ten times less than episodes; the true mean is 0.

    Intervals from resampled slices would cover it about 6 times in 10.
    """
    rng = np.random.default_rng(1)
    episode = np.repeat(np.arange(40), 5)
    covered = 0
    for _ in range(300):
        values = np.repeat(rng.normal(size=40), 5) + 0.1 * rng.normal(size=200)
        found = mean_of(values, episode)
        covered += bool(found.low <= 0.0 <= found.high)
    assert 0.90 <= covered / 300 <= 0.98


def test_a_single_episode_has_no_interval():
    found = mean_of([1.0, 3.0], [5, 5])
    assert found.value == 2.0
    assert np.isnan(found.low)
    assert np.isnan(found.high)
