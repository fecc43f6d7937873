"""Kinematic steering: back to the path, along a bend without error, still at a standstill."""

from math import atan, radians

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rolling_car import RollingCar

from rt_controller.contract.limits import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.contract.signals import ControlInput, PathReference
from rt_controller.control.steering import (
    path_curvature_per_m,
    roll_towards,
    wheel_angle_rad,
)

ON_THE_LINE = PathReference(0.0, 0.0, 0.0, 0.0, 2.0, 0.0)


def roll(
    car: RollingCar, path: PathReference, distance_m: float, assumed: SteeringGeometry
) -> list[float]:
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


def rolling(**values: float) -> RollingCar:
    return RollingCar(3.0, creep_mps2=0.0, slope_mps2=0.3, **values)  # type: ignore[arg-type]


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-1.0, 1.0),
    st.floats(-0.1, 0.1),
    st.floats(-0.008, 0.008),
    st.floats(0.85, 1.2),
    st.floats(1.5, 4.0),
)
def test_a_slow_car_returns_to_its_path_on_any_bend(
    ey_m: float, epsi_rad: float, curvature_per_m: float, ratio_error: float, wheelbase_m: float
) -> None:
    own = SteeringGeometry(wheelbase_m, 0.6 * wheelbase_m, 16.0)
    car = rolling(ey_m=ey_m, epsi_rad=epsi_rad, curvature_per_m=curvature_per_m)
    car.geometry = own
    assumed = own._replace(steering_ratio=own.steering_ratio * ratio_error)
    roll(car, ON_THE_LINE, 60.0, assumed)
    assert abs(car.ey_m) < 0.05


def test_a_car_on_its_bend_needs_the_angle_of_the_single_track_model() -> None:
    car = rolling(curvature_per_m=0.01)
    angles = roll(car, ON_THE_LINE, 40.0, DEFAULT_GEOMETRY)
    geometry = DEFAULT_GEOMETRY
    expected = geometry.steering_ratio * atan(geometry.wheelbase_m * 0.01)
    assert angles[-1] == pytest.approx(expected, rel=0.02)
    assert abs(car.ey_m) < 0.005  # by understeer that this car has not


def test_a_path_beside_the_line_is_reached_without_overshoot() -> None:
    car = rolling()
    path = ON_THE_LINE._replace(c0_m=0.5)
    highest = 0.0
    for distance_m in range(1, 40):
        roll(car, path, float(distance_m), DEFAULT_GEOMETRY)
        highest = max(highest, car.ey_m)
    assert 0.49 < car.ey_m <= highest < 0.54


def test_the_wheel_of_a_standing_car_stays_where_it_is() -> None:
    assert roll_towards(0.6, 0.1, 0.0) == 0.1
    assert roll_towards(0.6, 0.1, 1.0) == pytest.approx(0.1 + 2.0 * 0.025)
    assert roll_towards(0.6, 0.1, 5.0) == pytest.approx(0.1 + radians(200.0) * 0.025)
    assert roll_towards(0.6, 0.1, 0.09) == 0.1  # noise of the speed
    assert roll_towards(0.1001, 0.1, 3.0) == 0.1001


def test_the_wheel_of_a_car_that_rolls_back_stays_where_it_is() -> None:
    assert roll_towards(0.6, 0.1, -1.0) == 0.1
