"""Histories of motion, which moves a pose of some time ago on, and of the wanted speed."""

from math import cos, nan, sin

import pytest

from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.gateway.samples import LARGEST_MPS2, Motion, MotionHistory, SpeedSlope

YAW_RATE = 0.4


def circle(periods, vx_mps=20.0):
    history = MotionHistory()
    for k in range(periods):
        history.add(Motion(k * PERIOD_NS, vx_mps, 0.0, YAW_RATE))
    return history


def test_the_heading_turns_by_the_yaw_rate_since_the_measurement():
    assert circle(10).turned(5 * PERIOD_NS) == pytest.approx(YAW_RATE * 4 * 0.025)
    assert circle(10).turned(9 * PERIOD_NS) == 0.0
    assert circle(10).turned(round(8.5 * PERIOD_NS)) == pytest.approx(YAW_RATE * 0.5 * 0.025)


def test_the_position_moves_along_the_circle():
    history, now_s, then_s = circle(10), 9 * 0.025, 2 * 0.025
    radius = 20.0 / YAW_RATE
    yaw = YAW_RATE * now_s
    x = radius * (sin(yaw) - sin(YAW_RATE * then_s))
    y = radius * (cos(YAW_RATE * then_s) - cos(yaw))
    assert history.moved(2 * PERIOD_NS, yaw) == pytest.approx((x, y), abs=1e-4)


def test_a_measurement_of_the_present_is_not_moved():
    assert circle(3).moved(2 * PERIOD_NS, 1.0) == (0.0, 0.0)
    assert MotionHistory().moved(0, 0.0) == (0.0, 0.0)


def after(speeds_mps):
    slope = SpeedSlope()
    return [slope.mps2(v, k * PERIOD_NS) for k, v in enumerate(speeds_mps)][-1]


def test_a_constant_speed_has_no_slope():
    assert after([20.0]) == 0.0
    assert after([20.0] * 50) == 0.0


def test_a_ramp_has_its_slope_also_if_it_comes_in_steps():
    assert after([20.0 - 2.0 * PERIOD_S * k for k in range(50)]) == pytest.approx(-2.0)
    assert after([20.0 + 0.2 * (k // 4) for k in range(61)]) == pytest.approx(2.0, rel=0.1)


def test_a_step_is_limited_and_a_gap_is_not_a_slope():
    assert after([20.0, 25.0]) == LARGEST_MPS2
    slope = SpeedSlope()
    slope.mps2(20.0, 0)
    assert slope.mps2(25.0, 10 * 10**9) == 0.0


def test_a_speed_that_is_not_available_does_not_stay_in_the_slope():
    assert after([20.0, nan]) == 0.0
    assert after([20.0, nan, 20.0, 20.0 + PERIOD_S]) == pytest.approx(1.0)
