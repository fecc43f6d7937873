"""Faults that cause a safe stop, how it is driven, and how it ends."""

import errno
from unittest.mock import Mock

import can
import numpy as np
import pytest
from scripted_vehicle import CRUISING, ENGAGED, STANDING, STRAIGHT, fail, mode_and_cause

from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import COMMAND, VEHICLE_IDENTITY, Command, Identity, Node
from rt_controller.bus.send import Outbox
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, Mode
from rt_controller.safety.stop import ALONG_PATH


def test_another_message_catalogue_causes_a_safe_stop(rig):
    rig.tick(3)
    other, own = Identity(1, None), own_identity(None)
    for identity in (other, own, other, other):  # one alone may be of a foreign device
        assert rig.tick(5).mode is Mode.NOMINAL
        rig.vehicle.outbox.send(VEHICLE_IDENTITY, identity, rig.clock.now_ns())
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.PEER_MISMATCH)


def test_a_reset_is_granted_only_when_the_car_stands(rig):
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.mission = ENGAGED._replace(is_reset_requested=True)
    rig.vehicle.state = CRUISING
    assert rig.tick(2).mode is Mode.SAFE_STOP
    rig.vehicle.state = STANDING
    assert rig.tick().mode is Mode.STANDBY
    rig.vehicle.mission = ENGAGED
    assert rig.tick().mode is Mode.LOW_SPEED


def test_a_safe_stop_is_steered_along_the_path_until_the_car_stands(rig):
    rig.tick(3)
    rig.vehicle.is_watchdog_braking = True
    rig.tick()
    rig.vehicle.path = STRAIGHT._replace(c0_m=1.5)
    result = rig.tick(10)
    assert result.mode is Mode.SAFE_STOP
    assert result.control.steer_rad > 0.02
    rig.vehicle.state = CRUISING._replace(vx_mps=2.0, ds_m=0.05)
    result = rig.tick(60)
    assert result.qp_iterations == 0
    assert result.control.steer_rad > 0.02
    rig.vehicle.path = STRAIGHT._replace(c0_m=-1.5)
    rig.vehicle.state = STANDING
    standing = rig.tick(60)
    assert standing.mode is Mode.SAFE_STOP
    assert standing.control.steer_rad == result.control.steer_rad


@pytest.mark.parametrize("vx_mps", [0.2, -0.2])
def test_a_safe_stop_keeps_the_brake_of_a_held_car_and_presses_it_if_the_car_rolls(rig, vx_mps):
    rig.vehicle.state, rig.vehicle.path = AT_REST, STRAIGHT._replace(v_mps=0.0)
    rig.tick(40)
    rig.vehicle.state = AT_REST._replace(vx_mps=vx_mps)
    held_n = rig.tick(10).control.brake_n
    assert held_n > ALONG_PATH.most_n
    rig.step.request_stop()
    forces = [rig.tick().control.brake_n for _ in range(10)]
    assert rig.step.last.mode is Mode.SAFE_STOP
    assert [held_n, *forces] == sorted([held_n, *forces])
    rig.vehicle.state, rig.vehicle.path = None, STRAIGHT
    assert rig.tick(60).control.brake_n == forces[-1]
    rig.vehicle.state = AT_REST._replace(vx_mps=vx_mps)
    assert rig.tick(40).control.brake_n == INPUT_LIMITS.upper.brake_n


def test_the_wheel_of_a_car_that_a_safe_stop_holds_does_not_turn_with_noise(rig):
    rng = np.random.default_rng(0)
    rig.vehicle.state, rig.vehicle.path = AT_REST, STRAIGHT._replace(c0_m=0.5)
    rig.tick(3)
    rig.step.request_stop()
    before = rig.tick(2).control.steer_rad
    for _ in range(60):
        rig.vehicle.state = AT_REST._replace(vx_mps=rng.normal(0.0, 0.05))
        assert rig.tick().control.steer_rad == before


@pytest.mark.parametrize("mission", [None, ENGAGED._replace(is_engaged=False)])
def test_a_safe_stop_without_a_mission_is_steered_along_the_path(rig, mission):
    rig.vehicle.state = CRUISING._replace(vx_mps=2.5, ds_m=0.0625, ey_m=0.0, epsi_rad=0.0)
    rig.vehicle.path = STRAIGHT._replace(v_mps=2.5, c2_per_m=0.01)
    before = rig.tick(100).control.steer_rad
    if mission is not None:
        rig.step.request_stop()
    rig.vehicle.mission = None
    assert rig.tick(60).mode is Mode.SAFE_STOP
    rig.vehicle.mission = mission
    assert rig.tick(60).control.steer_rad == pytest.approx(before)
    assert rig.step.last.mode is Mode.SAFE_STOP


def test_a_failed_send_sets_the_bus_fault_of_the_next_heartbeat(rig, monkeypatch):
    rig.tick(2)
    with monkeypatch.context() as broken:
        broken.setattr(rig.controller_bus, "send", fail)
        rig.tick()
    rig.tick()
    assert rig.heartbeat.faults & Fault.BUS_FAULT
    rig.tick()
    assert not rig.heartbeat.faults & Fault.BUS_FAULT


def test_an_interface_that_is_down_is_the_named_cause_of_a_stop_that_a_reset_ends(rig, monkeypatch):
    down = can.CanOperationError("Error receiving: Network is down", errno.ENETDOWN)
    rig.tick(2)
    with monkeypatch.context() as switched_off:
        switched_off.setattr(rig.controller_bus, "recv", Mock(side_effect=down))
        assert mode_and_cause(rig.tick()) == (Mode.HOLD_PLAN, StopCause.INTERFACE_DOWN)
        assert mode_and_cause(rig.tick(2)) == (Mode.SAFE_STOP, StopCause.INTERFACE_DOWN)
    rig.tick(2)
    assert rig.step.last.state is not None
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.INTERFACE_DOWN)


def test_an_error_passive_controller_drives_on_and_says_so(rig):
    passive, active = 0x20, 0x40
    rig.tick(2)
    for detail, is_disturbed in ((passive, True), (active, False)):
        frame = can.Message(
            arbitration_id=0x004,
            is_extended_id=False,
            is_error_frame=True,
            data=bytes((0, detail, 0, 0, 0, 0, 0, 0)),
        )
        rig.vehicle_bus.send(frame, timeout=0)
        assert rig.tick().mode is Mode.NOMINAL
        assert bool(rig.heartbeat.faults & Fault.BUS_FAULT) == is_disturbed


def test_a_bus_that_cannot_be_read_causes_a_safe_stop(rig, monkeypatch):
    rig.tick(2)
    monkeypatch.setattr(rig.controller_bus, "recv", fail)
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.BUS_FAILED)


def test_a_second_controller_on_the_bus_causes_a_safe_stop(rig):
    rig.tick(3)
    other = Outbox(rig.vehicle_bus, Node.CONTROLLER)
    other.send(COMMAND, Command(NEUTRAL_INPUT, Mode.NOMINAL), 0)
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.SECOND_CONTROLLER)
