"""The supervisor stops a car whose actuators do not follow their commands."""

import pytest
from kinematic_car import (
    WatchedCar,
)

from rt_controller.contract.faults import StopCause


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"steer_rad": 0.3}, StopCause.STEERING_MISMATCH),
        ({"throttle": 0.5}, StopCause.THROTTLE_MISMATCH),
        ({"brake_n": 40.0}, StopCause.BRAKE_MISMATCH),
    ],
)
def test_an_actuator_that_does_not_follow_its_commands_stops_the_car(
    change: dict[str, float], cause: StopCause
) -> None:
    car = WatchedCar()
    car.feedback = car.control
    assert car.tick(20).alarm is StopCause.NONE
    car.feedback = car.control._replace(**change)
    assert [car.tick().alarm for _ in range(8)][-1] is cause


def test_an_actuator_that_is_150_ms_late_is_no_fault() -> None:
    car = WatchedCar()
    commands = [car.control._replace(steer_rad=0.05 * k) for k in range(8)]
    for k in range(30):
        car.control = commands[min(k, 7)]
        car.feedback = commands[min(max(k - 6, 0), 7)]
        assert car.tick().alarm not in (StopCause.STEERING_MISMATCH,)
