"""Prediction errors in the units of the paper's Table II, with intervals by whole episodes."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories

from offline.evaluation.bootstrap import estimate, mean_draws
from offline.evaluation.comparison import compare_models
from offline.evaluation.metrics import absolute_errors, ratios_of, state_units
from offline.evaluation.parts import whole_part
from rt_controller.contract.signals import VEHICLE, Schema, Signal

CAR = state_units(VEHICLE)


def evaluated(model, made):
    """Comparison of one model on these trajectories."""
    return compare_models({"m": model}, {}, [whole_part(made_test_set(made))], VEHICLE)


def test_errors_are_in_the_squared_units_of_the_papers_table():
    """Errors of 1 m/s, 1 rad/s, 1 m and 1 rad everywhere; the first state does not count."""
    made = made_trajectories(10)
    error = np.tile([1.0, -1.0, 1.0, 1.0, -1.0, 1.0], (10, 81, 1))
    error[:, 0] = 1e6
    rows = evaluated(WithError(made, error), made).library["m"][:6]
    degrees = np.degrees(1.0) ** 2
    expected = [12.96, 12.96, degrees, 1.0, 1.0, degrees]
    assert np.allclose([row.mse for row in rows], expected)
    assert np.allclose([row.rms for row in rows], np.sqrt(expected))
    assert [row.unit for row in rows] == ["km/h", "km/h", "deg/s", "m", "m", "deg"]


def test_rms_error_is_given_for_each_step():
    """An error of k metres at step k."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[..., 4] = np.arange(81)
    found = evaluated(WithError(made, error), made).by_step["m"]
    assert np.allclose(found.value[:, 4], np.arange(1, 81))
    assert np.allclose(found.low[:, 4], np.arange(1, 81))
    assert np.all(found.value[:, 0] == 0.0)


def test_diverging_predictions_have_infinite_errors_and_are_counted():
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, 40:, 0] = np.inf
    error[4, 40:, 0] = np.nan
    error[5, :, 1] = 1e200  # finite, but not its square
    comparison = evaluated(WithError(made, error), made)
    rows = comparison.library["m"][:6]
    assert rows[0].diverged == 2
    assert [np.isinf(row.mse) for row in rows] == [True, True, False, False, False, False]
    by_step = comparison.by_step["m"].value[:, 0]
    assert np.all(by_step[:39] == 0.0)
    assert np.all(np.isinf(by_step[39:]))


def test_a_model_gets_the_inputs_curvature_and_past_of_each_trajectory():
    made = made_trajectories(3)
    seen = {}

    class Watching:
        def predict(self, x0, past, U, W):
            seen.update(x0=x0, past=past, U=U, W=W)
            return made.x.astype(float)

    absolute_errors(Watching(), made_test_set(made), CAR)
    assert np.array_equal(seen["x0"], made.x[:, 0])
    for name, array in (("past", made.past), ("U", made.u), ("W", made.w)):
        assert np.array_equal(seen[name], array)
        assert seen[name].dtype == np.float64


def units_of(*states):
    return state_units(Schema(tuple(Signal(*state) for state in states), (), (), 0.1))


@pytest.mark.parametrize(
    ("state", "name", "unit"),
    [
        (("temperature_k", "K"), "temperature", "K"),
        (("ax_mps2", "m/s^2"), "ax", "m/s^2"),
        (("curvature_per_m", "1/m"), "curvature", "1/m"),
        (("gear", "1"), "gear", "1"),
        (("charge", ""), "charge", ""),
        (("speed", "m/s"), "speed", "km/h"),
    ],
)
def test_other_states_keep_their_unit_unless_it_is_m_per_s_or_rad(state, name, unit):
    (column,) = units_of(state)
    assert (column.name, column.unit) == (name, unit)


def draws(*values, count=5):
    return np.tile(np.array(values, dtype=float), (count, 1))


def means(found):
    return found.value[6:].tolist()


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
