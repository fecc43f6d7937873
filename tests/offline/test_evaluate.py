"""What a model gets wrong, in the units of the paper's Table I."""

import numpy as np
import pytest
from toy_predictors import Off, judged_on, made_trajectories, scattered

from offline import evaluate
from offline.evaluate import (
    SHARES,
    mse,
    mse_on_road,
    prediction_errors,
    quantiles_at_marks,
    rms,
    rms_by_step,
    score,
)
from offline.table_units import table_columns
from rt_controller.contract.schema import VEHICLE, Schema, Signal

CAR = table_columns(VEHICLE)


def test_errors_are_in_the_squared_units_of_the_papers_table():
    """Off by 1 m/s, 1 rad/s, 1 m and 1 rad everywhere."""
    made = made_trajectories(10)
    found = score(Off(made, [1.0, -1.0, 1.0, 1.0, -1.0, 1.0]), judged_on(made), CAR)
    degrees = np.degrees(1.0) ** 2
    assert np.allclose(mse(found).value, [12.96, 12.96, degrees, 1.0, 1.0, degrees])
    assert np.allclose(rms(found).value, np.sqrt(mse(found).value))


def test_the_first_state_is_measured_and_counts_for_nothing():
    made = made_trajectories(10)
    error = np.zeros(made.x.shape)
    error[:, 0] = 1e6
    found = score(Off(made, error), judged_on(made), CAR)
    assert found.squared.total.shape == (2, 80, 6)
    assert np.all(mse(found).value == 0.0)


def test_states_of_any_schema_are_judged():
    schema = Schema(
        (Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (Signal("power", "1"),), (), 0.1
    )
    made = made_trajectories(10, steps=30, states=2)
    found = score(Off(made, [1.0, 2.0]), judged_on(made), table_columns(schema))
    assert np.allclose(mse(found).value, [12.96, 4.0])
    assert found.marked.steps == (20,)


def test_the_error_of_each_step_has_a_place_of_its_own():
    """Off by k metres at step k."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[..., 4] = np.arange(81)
    by_step = rms_by_step(score(Off(made, error), judged_on(made), CAR))
    assert np.allclose(by_step.value[:, 4], np.arange(1, 81))
    assert np.allclose(by_step.low[:, 4], np.arange(1, 81))
    assert np.all(by_step.value[:, 0] == 0.0)


def test_errors_of_all_trajectories_count_the_same_however_many_an_episode_has():
    made = made_trajectories(4)
    made = made._replace(episode=np.array([0, 0, 0, 1], dtype=np.int32))
    error = np.zeros(made.x.shape)
    error[3, :, 3] = 2.0
    found = score(Off(made, error), judged_on(made), CAR)
    assert mse(found).value[3] == pytest.approx(1.0)


def test_quantiles_are_of_the_absolute_errors_of_the_trajectories():
    """Off by -1, -2, ... -100 m: half of them by 50 m or less."""
    made = made_trajectories(100)
    error = np.zeros(made.x.shape)
    error[..., 4] = -np.arange(1.0, 101.0)[:, None]
    found = score(Off(made, error), judged_on(made), CAR)
    assert found.quantiles.shape == (len(SHARES), 80, 6)
    assert np.allclose(found.quantiles[:, 7, 4], [50.0, 90.0, 99.0])
    marked = quantiles_at_marks(found)
    assert marked.value.shape == (3, 3, 6)
    assert np.allclose(marked.value[:, 1, 4], [50.0, 90.0, 99.0])
    assert np.all(marked.low[:, 1, 4] < marked.value[:, 1, 4])
    assert np.all(marked.value[:2, 1, 4] < marked.high[:2, 1, 4])


def test_pooled_errors_are_the_mean_of_those_on_each_road():
    made = made_trajectories(40)
    curvature = np.repeat([-1e-3, 0.0], [30, 10])
    found = score(scattered(made), judged_on(made, curvature), CAR)
    right, straight = (mse_on_road(found, kappa).value for kappa in (-1e-3, 0.0))
    assert np.allclose(0.75 * right + 0.25 * straight, mse(found).value)
    assert not np.allclose(right, straight)


def test_a_model_that_blows_up_is_infinitely_wrong_and_counted():
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, 40:, 0] = np.inf
    error[4, 40:, 0] = np.nan
    error[5, :, 1] = 1e200  # finite, but not its square
    found = score(Off(made, error), judged_on(made), CAR)
    assert found.diverged == 2
    assert np.isinf(mse(found).value).tolist() == [True, True, False, False, False, False]
    by_step = rms_by_step(found).value
    assert np.all(by_step[:39, 0] == 0.0)
    assert np.all(np.isinf(by_step[39:, 0]))


def test_a_long_test_set_is_predicted_piece_by_piece(monkeypatch):
    made = made_trajectories(23)
    model = scattered(made)
    at_once = prediction_errors(model, made, CAR)
    monkeypatch.setattr(evaluate, "_BATCH", 10)
    assert np.array_equal(prediction_errors(model, made, CAR), at_once)
    assert at_once.shape == (23, 80, 6)


def test_a_model_is_shown_the_inputs_the_road_and_the_past_of_each_trajectory():
    made = made_trajectories(3)
    seen = {}

    class Watching:
        def predict(self, x0, past, U, W):
            seen.update(x0=x0, past=past, U=U, W=W)
            return made.x.astype(float)

    score(Watching(), judged_on(made), CAR)
    assert np.array_equal(seen["x0"], made.x[:, 0])
    for name, array in (("past", made.past), ("U", made.u), ("W", made.w)):
        assert np.array_equal(seen[name], array)
        assert seen[name].dtype == np.float64
