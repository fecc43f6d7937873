"""The steering-wheel angle of a steady turn."""

from math import atan, radians

import pytest

from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import GRAVITY_MPS2

CAR = SteeringGeometry(wheelbase_m=3.0, rear_axle_m=1.5, steering_ratio=16.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_of_a_steady_turn_is_that_of_the_radius_and_the_understeer(side: float) -> None:
    slow_rad = CAR.steady_wheel_rad(1.0, side * 0.1)
    assert slow_rad == pytest.approx(side * 16.0 * atan(0.3), rel=0.01)
    of_1_g = CAR.steady_wheel_rad(20.0, side * GRAVITY_MPS2 / 20.0)
    rolling_rad = atan(3.0 * GRAVITY_MPS2 / 400.0)
    assert of_1_g == pytest.approx(side * 16.0 * (rolling_rad + radians(1.43)))
