"""A safe stop ramps the brake, closes the throttle and steers along the rest of the plan."""

import pytest

from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.fallback import (
    SAFE_STOP_BRAKE_N,
    SAFE_STOP_BRAKE_RATE_N_PER_S,
    input_for,
    safe_stop,
    stand_by,
)


def test_a_safe_stop_ramps_the_brake_to_its_maximum_and_holds_it() -> None:
    control = ControlInput(0.6, 0.0, 0.4)
    forces = []
    for _ in range(200):
        control = safe_stop(control, None)
        forces.append(control.brake_n)
        assert control.throttle == 0.0
    assert forces[0] == pytest.approx(SAFE_STOP_BRAKE_RATE_N_PER_S * PERIOD_S)
    assert forces == sorted(forces)
    assert forces[-1] == SAFE_STOP_BRAKE_N


def test_the_steering_follows_the_rest_of_the_plan_then_returns_to_zero() -> None:
    control = safe_stop(ControlInput(0.0, 0.0, 0.4), planned_steer_rad=0.38)
    assert control.steer_rad == 0.38
    for _ in range(100):
        returned = safe_stop(control, None)
        assert 0.0 <= returned.steer_rad <= control.steer_rad
        control = returned
    assert control.steer_rad == 0.0


def test_a_larger_brake_force_is_not_reduced() -> None:
    assert safe_stop(ControlInput(0.0, 60.0, 0.0), None).brake_n > 60.0


@pytest.mark.parametrize("steer_rad", [-0.5, -0.001, 0.0, 0.001, 0.5])
def test_standby_releases_the_pedals_and_returns_the_steering_to_zero(steer_rad: float) -> None:
    control = stand_by(ControlInput(0.3, 0.0, steer_rad))
    assert (control.throttle, control.brake_n) == (0.0, 0.0)
    assert abs(control.steer_rad) <= abs(steer_rad)
    assert control.steer_rad * steer_rad >= 0.0


def test_a_driven_mode_sends_the_plan_and_without_one_a_safe_stop() -> None:
    previous, planned = ControlInput(0.2, 0.0, 0.1), ControlInput(0.3, 0.0, 0.2)
    for mode in (Mode.NOMINAL, Mode.HOLD_PLAN):
        assert input_for(mode, planned, previous) == planned
        assert input_for(mode, None, previous) == safe_stop(previous, None)
    assert input_for(Mode.SAFE_STOP, planned, previous) == safe_stop(previous, planned.steer_rad)
    assert input_for(Mode.STANDBY, planned, previous) == stand_by(previous)
