"""Straight stops of the simulated car."""

import numpy as np
import pytest

from offline.evaluation.simulated_sets import PRESSED_AT_S, straight_braking_set
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import InputColumn, StateColumn
from rt_controller.contract.timing import PERIOD_S


@pytest.fixture(scope="module")
def stops():
    return straight_braking_set()


def test_every_stop_reaches_the_full_brake_within_the_limits_of_the_inputs(stops):
    u = stops.trajectories.u
    brake_n = u[..., InputColumn.brake_n]
    assert np.all(brake_n[:, -1] == INPUT_LIMITS.upper.brake_n)
    assert np.all(u[..., [InputColumn.throttle, InputColumn.steer_rad]] == 0.0)
    change = np.diff(brake_n, axis=1) / PERIOD_S
    assert change.max() <= INPUT_LIMITS.rate_per_s.brake_n * 1.001
    assert change.min() >= 0.0


def test_windows_of_one_drive_differ_in_when_the_brake_begins(stops):
    brake_n = stops.trajectories.u[: len(PRESSED_AT_S), :, InputColumn.brake_n]
    begins = [int(np.argmax(row > 0.0)) for row in brake_n]
    assert begins == [round(max(after_s, 0.0) / PERIOD_S) for after_s in PRESSED_AT_S]


def test_the_cars_keep_moving_straight(stops):
    x = stops.trajectories.x
    assert np.all(x[..., StateColumn.vx_mps] > 10.0 / 3.6)
    assert np.all(x[..., [StateColumn.vy_mps, StateColumn.yaw_rate_radps]] == 0.0)
    deceleration = -np.diff(x[..., StateColumn.vx_mps], axis=1) / PERIOD_S
    assert 6.0 < deceleration.max() < 10.0


def test_each_window_has_errors_of_its_own_on_a_straight_road(stops):
    first = stops.trajectories.x[:, 0]
    assert len(np.unique(first[:, StateColumn.ey_m])) == stops.n_trajectories
    assert np.all(stops.trajectories.w == 0.0)
    assert stops.n_episodes * len(PRESSED_AT_S) == stops.n_trajectories
