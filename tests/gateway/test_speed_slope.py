"""The acceleration of a wanted speed that comes without one."""

import math

import pytest

from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.gateway.samples import LARGEST_MPS2, SpeedSlope


def after(speeds_mps: list[float]) -> float:
    slope = SpeedSlope()
    return [slope.mps2(v, k * PERIOD_NS) for k, v in enumerate(speeds_mps)][-1]


def test_a_constant_speed_has_no_slope() -> None:
    assert after([20.0]) == 0.0
    assert after([20.0] * 50) == 0.0


def test_a_ramp_has_its_slope_also_if_it_comes_in_steps() -> None:
    assert after([20.0 - 2.0 * PERIOD_S * k for k in range(50)]) == pytest.approx(-2.0)
    assert after([20.0 + 0.2 * (k // 4) for k in range(61)]) == pytest.approx(2.0, rel=0.1)


def test_a_step_is_limited_and_a_gap_is_not_a_slope() -> None:
    assert after([20.0, 25.0]) == LARGEST_MPS2
    slope = SpeedSlope()
    slope.mps2(20.0, 0)
    assert slope.mps2(25.0, 10 * 10**9) == 0.0


def test_a_speed_that_is_not_available_does_not_stay_in_the_slope() -> None:
    assert after([20.0, math.nan]) == 0.0
    assert after([20.0, math.nan, 20.0, 20.0 + PERIOD_S]) == pytest.approx(1.0)
