"""A braking car without a model."""

from math import tan

import pytest

from rt_controller.contract.signals import ControlInput
from rt_controller.safety.coast_model import StoppingCar


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_brakes_and_rolls_along_the_circle_of_its_wheels(side: float) -> None:
    vx, vy, yaw_rate = StoppingCar().motion(10.0, ControlInput(0.0, 80.0, side * 0.37))
    assert vx == pytest.approx(10.0 - 0.05 * 80.0 * 0.025)
    assert yaw_rate == pytest.approx(side * 9.9 * tan(0.02) / 2.91)
    assert vy == pytest.approx(1.8604 * yaw_rate)


def test_a_car_stands_still_in_the_end() -> None:
    assert StoppingCar().motion(0.05, ControlInput(0.0, 80.0, 0.3)) == (0.0, 0.0, 0.0)


def test_a_slow_car_is_not_modelled() -> None:
    assert StoppingCar().modelled_mps == 7.0


def test_a_car_reaches_6_m_per_s2_with_its_throttle_fully_open() -> None:
    assert StoppingCar().throttle_mps2 == 6.0
