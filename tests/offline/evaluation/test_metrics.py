"""Prediction errors in the units of the paper's Table I."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation import predictor
from offline.evaluation.metrics import SHARES, score, state_units
from offline.evaluation.predictor import prediction_errors
from rt_controller.contract.schema import VEHICLE, Schema, Signal

CAR = state_units(VEHICLE)


def test_errors_are_in_the_squared_units_of_the_papers_table():
    """Errors of 1 m/s, 1 rad/s, 1 m and 1 rad everywhere."""
    made = made_trajectories(10)
    found = score(WithError(made, [1.0, -1.0, 1.0, 1.0, -1.0, 1.0]), made_test_set(made), CAR)
    degrees = np.degrees(1.0) ** 2
    assert np.allclose(found.mse().value, [12.96, 12.96, degrees, 1.0, 1.0, degrees])
    assert np.allclose(found.rms().value, np.sqrt(found.mse().value))


def test_the_first_state_does_not_count():
    made = made_trajectories(10)
    error = np.zeros(made.x.shape)
    error[:, 0] = 1e6
    found = score(WithError(made, error), made_test_set(made), CAR)
    assert found.squared.total.shape == (2, 80, 6)
    assert np.all(found.mse().value == 0.0)


def test_states_of_any_schema_have_errors():
    schema = Schema(
        (Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (Signal("power", "1"),), (), 0.1
    )
    made = made_trajectories(10, steps=30, states=2)
    found = score(WithError(made, [1.0, 2.0]), made_test_set(made), state_units(schema))
    assert np.allclose(found.mse().value, [12.96, 4.0])
    assert found.marked_steps == (20,)


def test_rms_error_is_given_for_each_step():
    """An error of k metres at step k."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[..., 4] = np.arange(81)
    by_step = score(WithError(made, error), made_test_set(made), CAR).rms_by_step()
    assert np.allclose(by_step.value[:, 4], np.arange(1, 81))
    assert np.allclose(by_step.low[:, 4], np.arange(1, 81))
    assert np.all(by_step.value[:, 0] == 0.0)


def test_all_trajectories_have_the_same_weight_in_episodes_of_any_length():
    made = made_trajectories(4)
    made = made._replace(episode=np.array([0, 0, 0, 1], dtype=np.int32))
    error = np.zeros(made.x.shape)
    error[3, :, 3] = 2.0
    found = score(WithError(made, error), made_test_set(made), CAR)
    assert found.mse().value[3] == pytest.approx(1.0)


def test_quantiles_are_of_the_absolute_errors_of_the_trajectories():
    """Errors of -1, -2, ... -100 m: half of them are at most 50 m."""
    made = made_trajectories(100)
    error = np.zeros(made.x.shape)
    error[..., 4] = -np.arange(1.0, 101.0)[:, None]
    found = score(WithError(made, error), made_test_set(made), CAR)
    assert found.quantiles.shape == (len(SHARES), 80, 6)
    assert np.allclose(found.quantiles[:, 7, 4], [50.0, 90.0, 99.0])
    marked = found.quantiles_at_marks()
    assert marked.value.shape == (3, 3, 6)
    assert np.allclose(marked.value[:, 1, 4], [50.0, 90.0, 99.0])
    assert np.all(marked.low[:, 1, 4] < marked.value[:, 1, 4])
    assert np.all(marked.value[:2, 1, 4] < marked.high[:2, 1, 4])


def test_pooled_errors_are_the_mean_of_those_on_each_road():
    made = made_trajectories(40)
    curvature = np.repeat([-1e-3, 0.0], [30, 10])
    test = made_test_set(made, curvature)
    found = score(with_random_error(made), test, CAR)
    right, straight = (
        found.by_trajectory.take(test.is_on_road(kappa)).mean().value for kappa in (-1e-3, 0.0)
    )
    assert np.allclose(0.75 * right + 0.25 * straight, found.mse().value)
    assert not np.allclose(right, straight)


def test_diverging_predictions_have_infinite_errors_and_are_counted():
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, 40:, 0] = np.inf
    error[4, 40:, 0] = np.nan
    error[5, :, 1] = 1e200  # finite, but not its square
    found = score(WithError(made, error), made_test_set(made), CAR)
    assert found.diverged == 2
    assert np.isinf(found.mse().value).tolist() == [True, True, False, False, False, False]
    by_step = found.rms_by_step().value
    assert np.all(by_step[:39, 0] == 0.0)
    assert np.all(np.isinf(by_step[39:, 0]))


def test_batches_of_a_long_test_set_give_the_same_errors(monkeypatch):
    made = made_trajectories(23)
    model = with_random_error(made)
    at_once = prediction_errors(model, made)
    monkeypatch.setattr(predictor, "_BATCH", 10)
    assert np.array_equal(prediction_errors(model, made), at_once)
    assert at_once.shape == (23, 80, 6)


def test_a_model_gets_the_inputs_curvature_and_past_of_each_trajectory():
    made = made_trajectories(3)
    seen = {}

    class Watching:
        def predict(self, x0, past, U, W):
            seen.update(x0=x0, past=past, U=U, W=W)
            return made.x.astype(float)

    score(Watching(), made_test_set(made), CAR)
    assert np.array_equal(seen["x0"], made.x[:, 0])
    for name, array in (("past", made.past), ("U", made.u), ("W", made.w)):
        assert np.array_equal(seen[name], array)
        assert seen[name].dtype == np.float64
