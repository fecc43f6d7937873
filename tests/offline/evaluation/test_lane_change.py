"""The open-loop double lane change."""

import numpy as np
import pytest

from offline.baselines.linear import Persistence
from offline.config import STEPS
from offline.evaluation.lane_change import WINDOWS, drive_lane_change
from offline.evaluation.predictor import predict_trajectories
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.timing import PERIOD_S


@pytest.fixture(scope="module")
def driven():
    return drive_lane_change()


def test_speed_road_and_displacement_are_those_of_the_paper(driven):
    """80 km/h, curvature 0.001, a lane to the left and back."""
    x = driven.windows.x
    assert np.all(driven.windows.w == np.float32(1e-3))
    assert np.allclose(3.6 * x[..., 0], 80.0, atol=1.0)
    assert x[..., 4].max() == pytest.approx(3.5, abs=0.2)
    assert np.abs(x[-1, -1, 4]) < 0.1
    assert "80 km/h" in driven.description
    assert "0.001 1/m" in driven.description


def test_the_driver_keeps_to_the_path(driven):
    assert np.abs(driven.windows.x[..., 4] - driven.desired_ey_m).max() < 0.2


def test_windows_are_consecutive(driven):
    x, time_s = driven.windows.x, driven.time_s
    assert x.shape == (WINDOWS, STEPS + 1, 6)
    assert np.allclose(x[1:, 0], x[:-1, -1], atol=1e-5)
    assert np.allclose(time_s[1:, 0], time_s[:-1, -1])
    assert time_s[-1, -1] == pytest.approx(2.0 * WINDOWS)


def test_progress_and_speed_agree(driven):
    """Fails if states are shifted by a period."""
    x = driven.windows.x.astype(float)
    ds_m = PERIOD_S * (x[..., :-1, 0] + x[..., 1:, 0]) / 2 * np.cos(x[..., 1:, 5])
    ds_m /= 1.0 - 1e-3 * x[..., 1:, 4]
    assert np.allclose(x[..., 1:, 3], ds_m, atol=3e-3)


def test_inputs_keep_to_the_limits_and_rates_of_the_controller(driven):
    u = driven.windows.u.reshape(-1, 3).astype(float)
    assert np.all(u >= np.array(INPUT_LIMITS.lower) - 1e-6)
    assert np.all(u <= np.array(INPUT_LIMITS.upper) + 1e-6)
    assert np.all(np.abs(np.diff(u, axis=0)) <= PERIOD_S * np.array(INPUT_LIMITS.rate_per_s) + 1e-6)


def test_the_past_is_the_end_of_the_window_before(driven):
    past, x, u = driven.windows.past, driven.windows.x, driven.windows.u
    assert np.array_equal(past[1:, :, :3], x[:-1, STEPS - 20 : STEPS, :3])
    assert np.array_equal(past[1:, :, 3:], u[:-1, STEPS - 20 :])


def test_yaw_rate_follows_the_steering_wheel(driven):
    """With a delay of 0.1 to 0.3 s; fails if inputs are shifted by periods."""
    steer = driven.windows.u[..., 2].ravel()
    yaw_rate = driven.windows.x[:, :-1, 2].ravel()
    lags = np.arange(-20, 21)
    correlation = [np.corrcoef(np.roll(steer, lag)[20:-20], yaw_rate[20:-20])[0, 1] for lag in lags]
    assert 0.05 <= PERIOD_S * lags[np.argmax(correlation)] <= 0.3


def test_predictions_start_from_the_measured_state_of_each_window(driven):
    predicted = predict_trajectories(Persistence(), driven.windows)
    assert np.array_equal(predicted, np.repeat(driven.windows.x[:, :1], STEPS + 1, axis=1))
