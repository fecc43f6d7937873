"""The estimate of v_y against the equation of a single-track car, integrated finely."""

from math import isnan, pi, sin

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.gateway.lateral_speed import LateralSpeed, RearAxle, identify
from rt_controller.model.bundle import Bundle

MASS_KG, INERTIA, FRONT_M, REAR_M = 1800.0, 3000.0, 1.2, 1.7
FRONT_STIFFNESS, REAR_STIFFNESS = 110e3, 130e3
CAR = RearAxle(
    REAR_M, MASS_KG * FRONT_M / ((FRONT_M + REAR_M) * REAR_STIFFNESS), INERTIA / (MASS_KG * FRONT_M)
)


def single_track(vx_mps, steps):
    """(v_y, yaw rate) every 25 ms of a linear single-track car in a sine of 1 Hz."""
    vy = yaw_rate = 0.0
    dt, found = 2.5e-4, []
    for k in range(100 * steps):
        if k % 100 == 0:
            found.append((vy, yaw_rate))
        wheel = 0.02 * sin(2.0 * pi * k * dt)
        front = FRONT_STIFFNESS * (wheel - (vy + FRONT_M * yaw_rate) / vx_mps)
        rear = -REAR_STIFFNESS * (vy - REAR_M * yaw_rate) / vx_mps
        vy += dt * ((front + rear) / MASS_KG - vx_mps * yaw_rate)
        yaw_rate += dt * (FRONT_M * front - REAR_M * rear) / INERTIA
    return np.array(found)


@pytest.mark.parametrize("vx_mps", [17.0, 22.0, 33.0])
def test_the_estimate_is_that_of_a_single_track_car(vx_mps):
    motion, estimator = single_track(vx_mps, 80), LateralSpeed(CAR)
    found = np.array([estimator.update(vx_mps, yaw_rate) for _, yaw_rate in motion])
    assert np.max(np.abs(found - motion[:, 0])) < 0.02 * np.max(np.abs(motion[:, 0]))


def test_the_rear_axle_of_a_slow_car_rolls_without_slip():
    estimator = LateralSpeed(CAR)
    assert estimator.update(0.5, 0.1) == pytest.approx(0.1 * REAR_M)
    assert estimator.update(0.0, 0.1) == 0.0


def test_a_missing_value_gives_none_and_is_forgotten():
    estimator = LateralSpeed(CAR)
    steady = estimator.update(20.0, 0.1)
    estimator.update(20.0, -0.4)
    assert isnan(estimator.update(float("nan"), 0.1))
    assert estimator.update(20.0, 0.1) == steady


def test_the_constants_come_from_the_learned_model():
    found = identify(Bundle.load("mdk-net"), DEFAULT_GEOMETRY)
    assert found.rear_axle_m == DEFAULT_GEOMETRY.rear_axle_m
    assert 0.004 < found.slip_s2_per_m < 0.0065
    assert 0.2 < found.inertia_m < 1.2


def test_a_linear_model_is_refused_with_the_remedy():
    with pytest.raises(ConfigError, match=r"expected vy_mps, .*rear_slip_s2_per_m"):
        identify(Bundle.load("lti"), DEFAULT_GEOMETRY)
