"""Means, medians and tails over trajectories."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories

from offline.evaluation.metrics import SHARES, TrajectoryErrors, score, state_units
from rt_controller.contract.schema import VEHICLE


def test_an_error_is_averaged_over_the_steps_of_its_trajectory():
    """An error of k metres at step k of trajectory 3 only."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, :, 4] = np.arange(81)
    found = score(WithError(made, error), made_test_set(made), state_units(VEHICLE)).by_trajectory
    assert found.mse[3, 4] == pytest.approx(np.square(np.arange(1, 81)).mean())
    assert np.count_nonzero(found.mse) == 1


def test_one_bad_trajectory_moves_the_mean_and_not_the_median():
    mse = np.ones((200, 2))
    mse[17, 0] = 1e4
    found = TrajectoryErrors(mse, np.arange(200, dtype=np.int32) // 5)
    assert found.mean().value == pytest.approx([50.995, 1.0])
    assert np.all(found.quantiles().value[SHARES.index(0.5)] == 1.0)
    assert np.all(found.quantiles().value[SHARES.index(0.99)] == 1.0)
    assert found.worst_part.value == pytest.approx([10_001 / 10_199, 0.01])


def test_a_prediction_that_is_not_finite_has_infinite_error_and_no_part_of_the_sum():
    made = made_trajectories(20)
    error = np.ones(made.x.shape)
    error[3, 40:, 0] = np.nan
    found = score(WithError(made, error), made_test_set(made), state_units(VEHICLE)).by_trajectory
    assert np.isinf(found.mse[3, 0])
    assert np.isinf(found.mean().value[0])
    assert found.quantiles().value[0, 0] == pytest.approx(3.6**2)
    assert np.isnan(found.worst_part.value[0])
    assert np.isfinite(found.worst_part.value[1])


def test_some_of_the_trajectories_keep_their_errors_and_episodes():
    errors = TrajectoryErrors(np.arange(8.0).reshape(4, 2), np.array([0, 0, 1, 1], dtype=np.int32))
    found = errors.take(np.array([False, True, True, False]))
    assert found.mse.tolist() == [[2.0, 3.0], [4.0, 5.0]]
    assert found.episode.tolist() == [0, 1]
