"""A safe stop ramps the brake, closes the throttle and steers along the rest of the plan."""

import pytest

from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.fallback import (
    ALONG_PATH,
    input_for,
    safe_stop,
    stand_by,
)


def test_a_safe_stop_ramps_the_brake_to_its_maximum_and_holds_it() -> None:
    control = ControlInput(0.6, 0.0, 0.4)
    forces = []
    for _ in range(200):
        control = safe_stop(control, None, is_held=False)
        forces.append(control.brake_n)
        assert control.throttle == 0.0
    assert forces[0] == pytest.approx(ALONG_PATH.rate_n_per_s * PERIOD_S)
    assert forces == sorted(forces)
    assert forces[-1] == ALONG_PATH.most_n


def test_the_steering_follows_the_rest_of_the_plan_then_returns_to_zero() -> None:
    planned = ControlInput(0.3, 0.0, 0.38)
    control = safe_stop(ControlInput(0.0, 0.0, 0.4), planned, is_held=False)
    assert control.steer_rad == 0.38
    for _ in range(100):
        returned = safe_stop(control, None, is_held=False)
        assert 0.0 <= returned.steer_rad <= control.steer_rad
        control = returned
    assert control.steer_rad == 0.0


def test_a_larger_brake_force_is_not_reduced() -> None:
    assert safe_stop(ControlInput(0.0, 60.0, 0.0), None, is_held=False).brake_n > 60.0


def test_the_brake_of_a_held_car_is_not_released_and_pressed_as_planned() -> None:
    held = ControlInput(0.0, 120.0, 0.1)
    assert safe_stop(held, None, is_held=True).brake_n == 120.0
    assert safe_stop(held, held._replace(brake_n=123.75), is_held=True).brake_n == 123.75
    assert safe_stop(held, held, is_held=False).brake_n == ALONG_PATH.most_n


@pytest.mark.parametrize("steer_rad", [-0.5, -0.001, 0.0, 0.001, 0.5])
def test_standby_releases_the_pedals_and_returns_the_steering_to_zero(steer_rad: float) -> None:
    control = stand_by(ControlInput(0.3, 0.0, steer_rad))
    assert (control.throttle, control.brake_n) == (0.0, 0.0)
    assert abs(control.steer_rad) <= abs(steer_rad)
    assert control.steer_rad * steer_rad >= 0.0


def test_a_driven_mode_sends_the_plan_and_without_one_a_safe_stop() -> None:
    previous, planned = ControlInput(0.2, 0.0, 0.1), ControlInput(0.3, 0.0, 0.2)
    for mode in (Mode.NOMINAL, Mode.HOLD_PLAN):
        assert input_for(mode, planned, previous, is_held=False) == planned
        assert input_for(mode, None, previous, False) == safe_stop(previous, None, False)
    stopped = input_for(Mode.SAFE_STOP, planned, previous, is_held=False)
    assert stopped == safe_stop(previous, planned, is_held=False)
    assert input_for(Mode.STANDBY, planned, previous, is_held=False) == stand_by(previous)


@pytest.mark.parametrize(
    ("steer_rad", "expected_rad"), [(0.5, 0.4825), (-0.5, -0.4825), (0.01, 0.0), (-0.01, 0.0)]
)
def test_the_wheel_returns_at_40_deg_per_s(steer_rad: float, expected_rad: float) -> None:
    returned = stand_by(ControlInput(0.0, 0.0, steer_rad))
    assert returned.steer_rad == pytest.approx(expected_rad)
