"""Faults that cause a safe stop, how it is driven, and how it ends."""

import pytest
from scripted_vehicle import CRUISING, ENGAGED, STANDING, STRAIGHT, Rig, fail, mode_and_cause

from rt_controller.bus.catalogue import COMMAND, VEHICLE_IDENTITY, Command, Fault, Identity
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.safety.modes import StopCause


def test_a_vehicle_whose_watchdog_brakes_causes_a_safe_stop(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.is_watchdog_braking = True
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.VEHICLE_BRAKING)


def test_another_message_catalogue_causes_a_safe_stop(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.outbox.send(VEHICLE_IDENTITY, Identity(1, None), rig.clock.now_ns())
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.PEER_MISMATCH)


def test_a_safe_stop_goes_on_when_states_are_received_again(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.state = CRUISING
    assert rig.tick(10).mode is Mode.SAFE_STOP


def test_a_reset_is_granted_only_when_the_car_stands(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.mission = ENGAGED._replace(is_reset_requested=True)
    rig.vehicle.state = CRUISING
    assert rig.tick(2).mode is Mode.SAFE_STOP
    rig.vehicle.state = STANDING
    assert rig.tick().mode is Mode.STANDBY
    rig.vehicle.mission = ENGAGED
    assert rig.tick().mode is Mode.NOMINAL


def test_the_last_command_is_that_of_a_safe_stop(rig: Rig) -> None:
    rig.tick(30)
    rig.step.send_safe_command()
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert rig.command.content.mode is Mode.SAFE_STOP
    assert rig.command.content.control.throttle == 0.0
    assert rig.command.content.control.brake_n > 0.0


def test_a_controller_started_while_the_watchdog_brakes_stands_by(rig: Rig) -> None:
    rig.vehicle.is_watchdog_braking = True
    assert rig.tick(5).mode is Mode.STANDBY
    rig.vehicle.is_watchdog_braking = False
    assert rig.tick().mode is Mode.NOMINAL


def test_a_safe_stop_is_steered_along_the_path_until_the_car_is_slow(rig: Rig) -> None:
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
    assert result.control.steer_rad == 0.0


def test_a_failed_send_sets_the_bus_fault_of_the_next_heartbeat(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.tick(2)
    with monkeypatch.context() as broken:
        broken.setattr(rig.controller_bus, "send", fail)
        rig.tick()
    rig.tick()
    assert rig.heartbeat.faults & Fault.BUS_FAULT
    rig.tick()
    assert not rig.heartbeat.faults & Fault.BUS_FAULT


def test_a_bus_that_cannot_be_read_causes_a_safe_stop(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.tick(2)
    monkeypatch.setattr(rig.controller_bus, "recv", fail)
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.BUS_FAILED)


def test_a_second_controller_on_the_bus_causes_a_safe_stop(rig: Rig) -> None:
    rig.tick(3)
    other = Outbox(rig.vehicle_bus, Node.CONTROLLER)
    other.send(COMMAND, Command(NEUTRAL_INPUT, Mode.NOMINAL), 0)
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.SECOND_CONTROLLER)
