"""A pose of some time ago is moved on by the motion since then."""

from math import cos, sin

import pytest

from rt_controller.gateway.samples import Motion, MotionHistory

PERIOD_NS = 25_000_000
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
