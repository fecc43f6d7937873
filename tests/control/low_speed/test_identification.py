"""Gains of the pedals from the models that ship, and from models that know nothing."""

import dataclasses

import numpy as np
import pytest

from rt_controller.config import LowSpeedSettings
from rt_controller.contract.car import Car
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.control.identification import (
    BRAKE_LIMITS_MPS2_PER_N,
    THROTTLE_LIMITS_MPS2,
    identify_gains,
)
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.node import choose_low_speed_car


@pytest.mark.parametrize("model", ["mdk-net", "mdk-net-paper", "lti"])
def test_the_brake_gain_of_every_shipped_model_is_that_of_the_car(model: str) -> None:
    gains = identify_gains(load_bundle(shipped_model(model)), 9.0)
    assert gains.brake_mps2_per_n == pytest.approx(0.047, rel=0.1)
    assert THROTTLE_LIMITS_MPS2[0] <= gains.throttle_mps2 <= 8.0


def made(throttle_mps2: float, brake_mps2_per_n: float) -> Bundle:
    """The speed integrates both pedals."""
    A, B = np.eye(6), np.zeros((6, 3))
    B[0, :2] = 0.025 * throttle_mps2, -0.025 * brake_mps2_per_n
    return Bundle.linear(A, B, np.zeros((6, 1)))


def test_the_gains_of_a_known_model_are_found() -> None:
    gains = identify_gains(made(7.0, 0.08), 4.0)
    assert gains.throttle_mps2 == pytest.approx(7.0)
    assert gains.brake_mps2_per_n == pytest.approx(0.08)


def test_gains_of_a_model_without_pedals_stay_within_limits() -> None:
    gains = identify_gains(made(-1.0, 0.0), 4.0)
    assert gains.throttle_mps2 == THROTTLE_LIMITS_MPS2[0]
    assert gains.brake_mps2_per_n == BRAKE_LIMITS_MPS2_PER_N[0]


def test_a_model_without_finite_speeds_is_refused() -> None:
    growing = dataclasses.replace(made(7.0, 0.08), A=np.full((6, 6), 1e200))
    with pytest.raises(ArtifactError, match=r"expected finite speeds .* found \[inf, .*Train"):
        identify_gains(growing, 4.0)


def test_settings_come_before_the_model_and_the_model_before_the_defaults() -> None:
    bundle = made(6.0, 0.08)
    car = choose_low_speed_car(bundle, LowSpeedSettings())
    assert (car.speeds.leave_mps, car.speeds.resume_mps) == (8.0, 9.0)
    assert car.geometry == SteeringGeometry(2.910, 1.8604, 18.5)
    assert car.hold_n == pytest.approx(4.0 / 0.08)
    known = dataclasses.replace(bundle, car=Car(SteeringGeometry(3.2, 1.5, 16.0)))
    settings = LowSpeedSettings(steering_ratio=14.0, throttle_mps2=2.0, below_mps=2.0)
    car = choose_low_speed_car(known, settings)
    assert car.geometry == SteeringGeometry(3.2, 1.5, 14.0)
    assert car.gains.throttle_mps2 == 2.0
    assert (car.speeds.leave_mps, car.speeds.resume_mps) == (2.0, 3.0)
