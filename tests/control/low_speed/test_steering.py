"""Kinematic steering, and the gains of the pedals from the model."""

import dataclasses
from math import atan, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rolling_car import RollingCar

from rt_controller.config import LowSpeedSettings
from rt_controller.contract.car import Car
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.contract.signals import ControlInput, PathReference
from rt_controller.control.identification import (
    BRAKE_LIMITS_MPS2_PER_N,
    THROTTLE_LIMITS_MPS2,
    identify_gains,
)
from rt_controller.control.steering import path_curvature_per_m, roll_towards, wheel_angle_rad
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.node import choose_low_speed_car

ON_THE_LINE = PathReference(0.0, 0.0, 0.0, 0.0, 2.0, 0.0)


def roll(car, path, distance_m, assumed):
    """Wheel angles on the way."""
    steer_rad, angles = 0.0, []
    state = car.state()
    while car.s_m < distance_m:
        curvature = path_curvature_per_m(state, path, car.curvature_per_m, assumed, 0.1)
        wanted_rad = wheel_angle_rad(curvature, car.vx_mps, assumed)
        steer_rad = roll_towards(wanted_rad, steer_rad, car.vx_mps)
        angles.append(steer_rad)
        state = car.step(ControlInput(0.0, 0.0, steer_rad))
    return angles


def rolling(**values):
    return RollingCar(3.0, creep_mps2=0.0, slope_mps2=0.3, **values)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-1.0, 1.0),
    st.floats(-0.1, 0.1),
    st.floats(-0.008, 0.008),
    st.floats(0.85, 1.2),
    st.floats(1.5, 4.0),
)
def test_a_slow_car_returns_to_its_path_on_any_bend(
    ey_m, epsi_rad, curvature_per_m, ratio_error, wheelbase_m
):
    own = SteeringGeometry(wheelbase_m, 0.6 * wheelbase_m, 16.0)
    car = rolling(ey_m=ey_m, epsi_rad=epsi_rad, curvature_per_m=curvature_per_m)
    car.geometry = own
    assumed = own._replace(steering_ratio=own.steering_ratio * ratio_error)
    roll(car, ON_THE_LINE, 60.0, assumed)
    assert abs(car.ey_m) < 0.05


def test_a_car_on_its_bend_needs_the_angle_of_the_single_track_model():
    car = rolling(curvature_per_m=0.01)
    angles = roll(car, ON_THE_LINE, 40.0, DEFAULT_GEOMETRY)
    geometry = DEFAULT_GEOMETRY
    expected = geometry.steering_ratio * atan(geometry.wheelbase_m * 0.01)
    assert angles[-1] == pytest.approx(expected, rel=0.02)
    assert abs(car.ey_m) < 0.005  # by understeer that this car has not


def test_a_path_beside_the_line_is_reached_without_overshoot():
    car = rolling()
    path = ON_THE_LINE._replace(c0_m=0.5)
    highest = 0.0
    for distance_m in range(1, 40):
        roll(car, path, float(distance_m), DEFAULT_GEOMETRY)
        highest = max(highest, car.ey_m)
    assert 0.49 < car.ey_m <= highest < 0.54


@pytest.mark.parametrize(
    ("wanted_rad", "vx_mps", "expected_rad"),
    [
        (0.6, -1.0, 0.1),
        (0.6, 0.0, 0.1),
        (0.6, 0.09, 0.1),  # noise of the speed
        (0.6, 1.0, 0.1 + 2.0 * 0.025),
        (0.6, 5.0, 0.1 + radians(200.0) * 0.025),
        (0.1001, 3.0, 0.1001),
    ],
)
def test_the_wheel_turns_only_while_the_car_rolls_forwards(wanted_rad, vx_mps, expected_rad):
    assert roll_towards(wanted_rad, 0.1, vx_mps) == pytest.approx(expected_rad, abs=1e-12)


@pytest.mark.parametrize("model", ["mdk-net", "mdk-net-paper", "lti"])
def test_the_brake_gain_of_every_shipped_model_is_that_of_the_car(model):
    gains = identify_gains(load_bundle(shipped_model(model)), 9.0)
    assert gains.brake_mps2_per_n == pytest.approx(0.047, rel=0.1)
    assert THROTTLE_LIMITS_MPS2[0] <= gains.throttle_mps2 <= 8.0


def made(throttle_mps2, brake_mps2_per_n):
    """The speed integrates both pedals."""
    A, B = np.eye(6), np.zeros((6, 3))
    B[0, :2] = 0.025 * throttle_mps2, -0.025 * brake_mps2_per_n
    return Bundle.linear(A, B, np.zeros((6, 1)))


@pytest.mark.parametrize(
    ("of_model", "expected"),
    [
        ((7.0, 0.08), (7.0, 0.08)),
        ((-1.0, 0.0), (THROTTLE_LIMITS_MPS2[0], BRAKE_LIMITS_MPS2_PER_N[0])),
    ],
    ids=["known", "without pedals"],
)
def test_the_gains_of_a_model_are_found_within_limits(of_model, expected):
    gains = identify_gains(made(*of_model), 4.0)
    assert (gains.throttle_mps2, gains.brake_mps2_per_n) == pytest.approx(expected)


def test_a_model_without_finite_speeds_is_refused():
    growing = dataclasses.replace(made(7.0, 0.08), A=np.full((6, 6), 1e200))
    with pytest.raises(ArtifactError, match=r"expected finite speeds .* found \[inf, .*Train"):
        identify_gains(growing, 4.0)


def test_settings_come_before_the_model_and_the_model_before_the_defaults():
    bundle = made(6.0, 0.08)
    car = choose_low_speed_car(bundle, LowSpeedSettings())
    assert (car.speeds.leave_mps, car.speeds.resume_mps) == (8.0, 9.0)
    assert car.geometry == SteeringGeometry(2.910, 1.8604, 18.5)
    assert car.hold_n == pytest.approx(4.0 / 0.08)
    known = dataclasses.replace(bundle, car=Car(3.2, 1.5, 16.0))
    settings = LowSpeedSettings(steering_ratio=14.0, throttle_mps2=2.0, below_mps=2.0)
    car = choose_low_speed_car(known, settings)
    assert car.geometry == SteeringGeometry(3.2, 1.5, 14.0)
    assert car.gains.throttle_mps2 == 2.0
    assert (car.speeds.leave_mps, car.speeds.resume_mps) == (2.0, 3.0)
