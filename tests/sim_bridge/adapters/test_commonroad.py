"""CommonRoad's multi-body car with the model of the actuators."""

from math import nan

import numpy as np
import pytest

pytest.importorskip("vehiclemodels", reason="the extra [commonroad] is not installed")

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.adapters.commonroad import (
    BRAKE_MPS2_PER_N,
    FULL_THROTTLE_MPS2,
    STEERING_RATIO,
    CommonRoadPlant,
    commanded_mps2,
)
from sim_bridge.car import Car

CRUISE_22 = 0.068
"""throttle that about holds 22 m/s"""


def drive(car: Car, control: ControlInput, periods: int) -> None:
    for _ in range(periods):
        car.advance(control, 0.0)


def test_the_steady_turn_of_vehicle_2_has_the_yaw_rate_of_the_model() -> None:
    """0.02 rad at the road wheels and 22.2 m/s: 10.0 deg/s, roll 3.5 deg, to the side it should."""
    car = Car(CommonRoadPlant(2, 1.0), 22.2)
    steer_rad = 0.02 * STEERING_RATIO
    drive(car, ControlInput(CRUISE_22, 0.0, steer_rad), 120)
    assert car.state.vx_mps == pytest.approx(22.2, abs=0.15)
    assert np.degrees(car.state.yaw_rate_radps) == pytest.approx(10.02, rel=0.03)
    outputs = car.plant.outputs()
    assert np.degrees(outputs.roll_rad) == pytest.approx(3.53, rel=0.1)
    assert outputs.road_wheel_rad == pytest.approx(0.02)
    assert outputs.ay_mps2 == pytest.approx(car.state.yaw_rate_radps * car.state.vx_mps, rel=0.05)


def test_acceleration_is_proportional_to_the_pedals() -> None:
    standing = commanded_mps2(ControlInput(1.0, 0.0, 0.0), 0.0, 0.001)
    assert standing == pytest.approx(FULL_THROTTLE_MPS2, abs=0.06)
    coasting = commanded_mps2(NEUTRAL_INPUT, 30.0, 0.001)
    assert coasting < 0.0
    braking = commanded_mps2(ControlInput(0.0, 150.0, 0.0), 30.0, 0.001)
    assert braking - coasting == pytest.approx(-150.0 * BRAKE_MPS2_PER_N)
    fast = commanded_mps2(ControlInput(1.0, 0.0, 0.0), 40.0, 0.001)
    assert fast - commanded_mps2(NEUTRAL_INPUT, 40.0, 0.001) == pytest.approx(90.0 / 40.0)


def test_a_braked_car_pitches_forward_and_stops() -> None:
    car = Car(CommonRoadPlant(2, 0.85), 15.0)
    brake = ControlInput(0.0, 100.0, 0.2)
    drive(car, brake, 40)
    assert car.plant.outputs().ax_mps2 == pytest.approx(-100.0 * BRAKE_MPS2_PER_N, rel=0.1)
    assert np.degrees(car.plant.outputs().pitch_rad) > 0.5
    drive(car, brake, 140)
    s_m = car.s_m
    drive(car, brake, 40)
    assert abs(car.state.vx_mps) < 1e-6
    assert abs(car.s_m - s_m) < 1e-3
    assert car.is_sound


def test_a_state_that_is_not_finite_is_a_failure() -> None:
    car = Car(CommonRoadPlant(2, 0.85), 20.0)
    drive(car, ControlInput(0.2, 0.0, nan), 2)
    assert not car.is_sound
    assert car.plant.failure is not None
    assert "commonroad:2: at 0.001 s" in car.plant.failure
    car.reset(20.0)
    drive(car, NEUTRAL_INPUT, 2)
    assert car.is_sound


def test_a_car_that_rolls_over_is_a_failure() -> None:
    """The model itself continues, with accelerations of a hundred m/s^2."""
    car = Car(CommonRoadPlant(2, 1.0), 22.2)
    drive(car, ControlInput(CRUISE_22, 0.0, 0.08 * STEERING_RATIO), 60)
    assert not car.is_sound
    assert "rolled over" in (car.plant.failure or "")


def test_a_negative_initial_speed_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"initial speed: expected 0\.\.70 m/s"):
        CommonRoadPlant(2, 0.85).reset(-1.0)
