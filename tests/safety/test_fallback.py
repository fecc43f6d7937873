"""A safe stop is a brake that ramps, a closed throttle and a wheel that does not freeze."""

import pytest

from rt_controller.contract.signals import ControlInput
from rt_controller.safety.fallback import (
    SAFE_STOP_BRAKE_N,
    SAFE_STOP_BRAKE_RATE_N_PER_S,
    safe_stop,
    stand_by,
)


def test_a_safe_stop_ramps_the_brake_to_its_end_and_holds_it() -> None:
    control = ControlInput(0.6, 0.0, 0.4)
    forces = []
    for _ in range(200):
        control = safe_stop(control, None)
        forces.append(control.brake_n)
        assert control.throttle == 0.0
    assert forces[0] == pytest.approx(SAFE_STOP_BRAKE_RATE_N_PER_S * 0.025)
    assert forces == sorted(forces)
    assert forces[-1] == SAFE_STOP_BRAKE_N


def test_the_wheel_follows_the_rest_of_the_plan_then_eases_to_the_middle() -> None:
    control = safe_stop(ControlInput(0.0, 0.0, 0.4), planned_steer_rad=0.38)
    assert control.steer_rad == 0.38
    for _ in range(100):
        eased = safe_stop(control, None)
        assert 0.0 <= eased.steer_rad <= control.steer_rad
        control = eased
    assert control.steer_rad == 0.0


def test_a_firmer_brake_is_not_taken_back() -> None:
    assert safe_stop(ControlInput(0.0, 60.0, 0.0), None).brake_n > 60.0


@pytest.mark.parametrize("steer_rad", [-0.5, -0.001, 0.0, 0.001, 0.5])
def test_standing_by_releases_the_pedals_and_eases_the_wheel(steer_rad: float) -> None:
    control = stand_by(ControlInput(0.3, 0.0, steer_rad))
    assert (control.throttle, control.brake_n) == (0.0, 0.0)
    assert abs(control.steer_rad) <= abs(steer_rad)
    assert control.steer_rad * steer_rad >= 0.0
