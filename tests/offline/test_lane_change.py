"""The paper's double lane change, driven once and foreseen by models."""

import numpy as np
import pytest
from toy_predictors import Hold

from offline.lane_change import WINDOWS, drive_lane_change, predict_windows
from offline.lengths import STEPS
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.timing import PERIOD_S


@pytest.fixture(scope="module")
def driven():
    return drive_lane_change()


def test_it_is_the_papers_manoeuvre(driven):
    """80 km/h, curvature 0.001, a lane to the left and back."""
    x = driven.windows.x
    assert np.all(driven.windows.w == np.float32(1e-3))
    assert np.allclose(3.6 * x[..., 0], 80.0, atol=1.0)
    assert x[..., 4].max() == pytest.approx(3.5, abs=0.2)
    assert np.abs(x[-1, -1, 4]) < 0.1
    assert "80 km/h" in driven.words
    assert "0.001 1/m" in driven.words


def test_the_driver_keeps_to_the_path(driven):
    assert np.abs(driven.windows.x[..., 4] - driven.wanted_ey_m).max() < 0.2


def test_a_window_begins_where_the_one_before_ends(driven):
    """With the same state, on the same road, at the same time."""
    x, time_s = driven.windows.x, driven.time_s
    assert x.shape == (WINDOWS, STEPS + 1, 6)
    assert np.allclose(x[1:, 0], x[:-1, -1], atol=1e-5)
    assert np.allclose(time_s[1:, 0], time_s[:-1, -1])
    assert time_s[-1, -1] == pytest.approx(2.0 * WINDOWS)


def test_progress_and_speed_agree(driven):
    """An input or state that was a period late would show here."""
    x = driven.windows.x.astype(float)
    ds_m = PERIOD_S * (x[..., :-1, 0] + x[..., 1:, 0]) / 2 * np.cos(x[..., 1:, 5])
    ds_m /= 1.0 - 1e-3 * x[..., 1:, 4]
    assert np.allclose(x[..., 1:, 3], ds_m, atol=3e-3)


def test_models_get_inputs_of_the_controllers_box_and_rates(driven):
    u = driven.windows.u.reshape(-1, 3).astype(float)
    assert np.all(u >= np.array(INPUT_LIMITS.lower) - 1e-6)
    assert np.all(u <= np.array(INPUT_LIMITS.upper) + 1e-6)
    assert np.all(np.abs(np.diff(u, axis=0)) <= PERIOD_S * np.array(INPUT_LIMITS.rate_per_s) + 1e-6)


def test_the_past_is_what_was_driven_right_before(driven):
    """Its last row leads to the first state of the window."""
    past, x, u = driven.windows.past, driven.windows.x, driven.windows.u
    assert np.array_equal(past[1:, :, :3], x[:-1, STEPS - 20 : STEPS, :3])
    assert np.array_equal(past[1:, :, 3:], u[:-1, STEPS - 20 :])


def test_the_car_turns_after_the_wheel_and_not_before(driven):
    """Inputs are those that act from each state on: the yaw rate follows the wheel by 0.1-0.3 s."""
    steer = driven.windows.u[..., 2].ravel()
    yaw_rate = driven.windows.x[:, :-1, 2].ravel()
    lags = np.arange(-20, 21)
    likeness = [np.corrcoef(np.roll(steer, lag)[20:-20], yaw_rate[20:-20])[0, 1] for lag in lags]
    assert 0.05 <= PERIOD_S * lags[np.argmax(likeness)] <= 0.3


def test_a_model_starts_anew_at_each_window(driven):
    foreseen = predict_windows(Hold(), driven.windows)
    assert np.array_equal(foreseen, np.repeat(driven.windows.x[:, :1], STEPS + 1, axis=1))
