"""Start, stop and hold on the bus: modes and commands at low speed and at a standstill."""

import pytest
from scripted_vehicle import CRUISING, STRAIGHT, Rig

from rt_controller.bus.identity import DISENGAGED_FRAMES
from rt_controller.contract.signals import AT_REST, Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS

REST = STRAIGHT._replace(v_mps=0.0)
CREEPING = CRUISING._replace(vx_mps=2.0, ds_m=0.05, ey_m=0.0, epsi_rad=0.0)


def stand(rig: Rig) -> None:
    rig.vehicle.state, rig.vehicle.path = AT_REST, REST


def test_a_standing_car_is_held_with_the_wheel_where_it_is(rig):
    stand(rig)
    result = rig.tick(40)
    assert result.mode is Mode.STANDSTILL
    assert rig.command.content.mode is Mode.STANDSTILL
    assert result.control.throttle == 0.0
    assert result.control.brake_n == pytest.approx(75.0)
    assert result.control.steer_rad == 0.0
    assert result.qp_iterations == 0


def test_the_brake_is_released_before_the_car_starts(rig):
    stand(rig)
    rig.tick(40)
    rig.vehicle.path = REST._replace(a_mps2=1.5)
    modes, controls = [], []
    for k in range(40):
        rig.vehicle.path = REST._replace(v_mps=1.5 * 0.025 * k, a_mps2=1.5)
        result = rig.tick()
        modes.append(result.mode)
        controls.append(result.control)
    assert set(modes) == {Mode.LOW_SPEED}
    assert all(control.throttle == 0.0 or control.brake_n == 0.0 for control in controls)
    assert controls[-1].throttle > 0.1


def test_a_slow_car_is_driven_without_the_model_and_a_faster_one_with_it(rig):
    rig.vehicle.state = CREEPING
    assert rig.tick().mode is Mode.LOW_SPEED
    rig.vehicle.state = CREEPING._replace(vx_mps=4.5, ds_m=0.11)
    result = rig.tick()
    assert result.mode is Mode.NOMINAL
    assert result.qp_iterations > 0
    rig.vehicle.state = CREEPING._replace(vx_mps=3.5, ds_m=0.09)
    assert rig.tick().mode is Mode.NOMINAL
    rig.vehicle.state = CREEPING
    assert rig.tick().mode is Mode.LOW_SPEED


def test_the_model_continues_with_the_pedal_that_is_pressed(rig):
    rig.vehicle.path = STRAIGHT._replace(v_mps=2.0, a_mps2=-2.0)
    rig.vehicle.state = CRUISING._replace(vx_mps=8.0, ds_m=0.2)
    assert rig.tick(10).control.brake_n > 0.0  # the model brakes
    rig.vehicle.state = CREEPING
    rig.vehicle.path = STRAIGHT
    assert rig.tick(40).control.throttle > 0.2
    before = rig.step.last.control.throttle
    rig.vehicle.state = CREEPING._replace(vx_mps=4.1, ds_m=0.1)
    result = rig.tick()
    assert result.mode is Mode.NOMINAL
    assert result.control.throttle == pytest.approx(before, abs=0.1)


def test_without_states_the_input_is_held_and_then_the_car_stopped(rig):
    stand(rig)
    held = rig.tick(40).control
    rig.vehicle.state = None
    for _ in range(HOLD_PLAN_TICKS):
        result = rig.tick()
        assert result.mode is Mode.HOLD_PLAN
        assert result.control == held
    result = rig.tick()
    assert result.mode is Mode.SAFE_STOP
    assert result.control == held


def test_the_end_of_a_mission_at_a_standstill_hands_the_car_over(rig):
    stand(rig)
    rig.tick(10)
    rig.vehicle.mission = rig.vehicle.mission._replace(is_engaged=False)
    result = rig.tick(DISENGAGED_FRAMES)
    assert result.mode is Mode.STANDBY
    assert result.control.throttle == 0.0
