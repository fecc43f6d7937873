"""The state that a stop is driven from, if none arrives or it is faulty."""

from dataclasses import replace

import pytest
from kinematic_car import (
    STRAIGHT,
    WatchedCar,
    nothing,
    replaced,
    shifted,
    turning,
)

from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.contract.signals import NEUTRAL_INPUT


def test_a_lost_state_is_estimated_along_the_last_path() -> None:
    car = turning(path=STRAIGHT)
    car.tick(20)
    car.disturb, car.is_stopping = nothing, True
    qualified = car.tick(40)
    assert qualified.speed_mps is None
    assert not qualified.is_measured
    assert not qualified.is_path_received
    assert qualified.state is not None
    assert qualified.state.ey_m == pytest.approx(car.state.ey_m, abs=0.05)
    assert qualified.state.epsi_rad == pytest.approx(car.state.epsi_rad, abs=0.005)
    assert qualified.path is not None


def test_a_braking_car_without_states_comes_to_rest() -> None:
    car = WatchedCar(has_model=False)
    car.tick(5)
    car.disturb, car.is_stopping = nothing, True
    car.control = car.control._replace(brake_n=75.0)
    qualified = car.tick(300)
    assert qualified.state is not None
    assert qualified.state.vx_mps == 0.0


def test_without_any_state_nothing_is_accepted() -> None:
    car = WatchedCar()
    car.disturb = lambda received: replace(received, state=None)
    assert car.tick(3).state is None


def test_faulty_signals_of_a_safe_stop_last_until_standby() -> None:
    car = WatchedCar()
    car.tick(20)
    car.disturb, car.is_stopping = shifted(ey_m=2.0), True
    car.tick(3)
    car.disturb = shifted(ey_m=0.1)
    qualified = car.tick(5)
    assert not qualified.is_measured
    car.is_driven = False
    assert car.tick().is_measured


def test_a_stop_without_speed_and_progress_has_no_known_speed() -> None:
    car = WatchedCar()
    car.tick(20)
    car.is_stopping = True
    car.disturb = replaced(vx_mps=0.0)
    assert car.tick(3).speed_mps == pytest.approx(20.0, abs=0.2)
    car.disturb = replaced(vx_mps=0.0, ds_m=0.3)
    car.tick(20)
    qualified = car.tick()
    assert qualified.speed_mps is None or qualified.speed_mps > 10.0


def test_a_command_that_is_not_known_ends_the_predictions() -> None:
    car = WatchedCar()
    car.tick(20)
    car.disturb = lambda received: replace(received, applied=None)
    assert car.tick(5).is_measured


def test_counter_steering_is_the_wheel_beyond_that_of_a_steady_turn() -> None:
    car = turning(path=STRAIGHT)
    assert car.supervisor.cornering(NEUTRAL_INPUT)[:3] == (0.0, 0.0, 0.0)
    car.tick(20)
    state, geometry = car.state, DEFAULT_GEOMETRY
    steady_rad = geometry.steady_wheel_rad(state.vx_mps, state.yaw_rate_radps)
    turned = NEUTRAL_INPUT._replace(steer_rad=0.3)
    found = car.supervisor.cornering(turned)
    assert found.counter_steering_rad == pytest.approx(0.3 - steady_rad)
    assert found.lateral_mps2 == pytest.approx(state.vx_mps * state.yaw_rate_radps)


@pytest.mark.parametrize(("vx_mps", "expected_rad"), [(9.1, 0.3), (8.9, 0.0)])
def test_a_slow_car_has_no_counter_steering(vx_mps: float, expected_rad: float) -> None:
    car = WatchedCar(vx_mps=vx_mps)
    car.tick(5)
    turned = NEUTRAL_INPUT._replace(steer_rad=0.3)
    found_rad = car.supervisor.cornering(turned).counter_steering_rad
    assert found_rad == pytest.approx(expected_rad, abs=1e-6)
