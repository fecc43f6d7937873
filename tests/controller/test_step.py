"""What the controller does when the bus, the solver or the vehicle does not do its part."""

import math

import can
import pytest
from scripted_vehicle import CRUISING, ENGAGED, STRAIGHT, VALID_NS, Rig, build_rig

from rt_controller.bus.frames import Fault
from rt_controller.bus.outbox import ControllerOutbox
from rt_controller.bus.snapshot import PeerIdentity
from rt_controller.contract.signals import ControlInput, Mode, PathReference
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.control.mpc import Mpc
from rt_controller.control.solver import SolveStatus
from rt_controller.outcome import StopCause

CRUISE = ControlInput(0.1, 0.0, 0.0)


def test_an_engaged_mission_and_a_fresh_state_drive(rig: Rig) -> None:
    outcome = rig.tick()
    assert outcome.mode is Mode.NOMINAL
    assert outcome.qp_iterations > 0
    assert rig.command.mode is Mode.NOMINAL
    assert rig.command.control.steer_rad < 0.0  # the car is left of its path and turned left


def test_without_a_mission_the_controller_stands_by(rig: Rig) -> None:
    rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
    outcome = rig.tick(5)
    assert outcome.mode is Mode.STANDBY
    assert rig.command.control == (0.0, 0.0, 0.0)
    assert outcome.qp_iterations == 0


def test_a_missing_state_holds_the_plan_for_two_ticks_and_then_stops(rig: Rig) -> None:
    rig.tick(5)
    plan = rig.mpc.inputs.copy()
    rig.vehicle.state = None
    for held in range(1, HOLD_PLAN_TICKS + 1):
        outcome = rig.tick()
        assert outcome.mode is Mode.HOLD_PLAN
        assert outcome.control == pytest.approx(plan[held], abs=1e-3)
    outcome = rig.tick()
    assert outcome.mode is Mode.SAFE_STOP
    assert outcome.cause is StopCause.STATE_LOST
    assert outcome.control.throttle == 0.0
    assert outcome.control.brake_n > 0.0


def test_a_state_that_comes_back_in_time_ends_the_hold(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    assert rig.tick(2).mode is Mode.HOLD_PLAN
    rig.vehicle.state = CRUISING
    assert rig.tick().mode is Mode.NOMINAL


@pytest.mark.parametrize("field", CRUISING._fields)
def test_a_state_frame_with_nan_is_no_state(rig: Rig, field: str) -> None:
    rig.tick(3)
    rig.vehicle.state = CRUISING._replace(**{field: math.nan})
    assert rig.tick().mode is Mode.HOLD_PLAN
    assert rig.inbox.counts.out_of_range > 0
    assert rig.tick(2).mode is Mode.SAFE_STOP
    assert all(math.isfinite(value) for value in rig.command.control)


def test_a_state_declared_invalid_is_no_state(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.is_valid = False
    assert rig.tick(3).mode is Mode.SAFE_STOP


def test_a_path_lives_three_periods(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.path = None
    assert rig.tick(3).mode is Mode.NOMINAL
    assert rig.tick(2).mode is Mode.HOLD_PLAN
    outcome = rig.tick()
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.REFERENCE_LOST)


def test_a_mission_whose_validity_runs_out_stops_the_car(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.mission = None
    assert rig.tick(VALID_NS // 25_000_000).mode is Mode.NOMINAL
    outcome = rig.tick()
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.MISSION_LOST)


@pytest.mark.parametrize("status", [s for s in SolveStatus if s is not SolveStatus.SOLVED])
def test_a_failed_solve_holds_the_plan_and_then_stops(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, status: SolveStatus
) -> None:
    rig.tick(3)
    plan = rig.mpc.inputs.copy()
    monkeypatch.setattr(rig.mpc, "plan", lambda *_: status)
    outcome = rig.tick()
    assert outcome.mode is Mode.HOLD_PLAN
    assert outcome.control == pytest.approx(plan[1], abs=1e-3)
    outcome = rig.tick(2)
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.SOLVER_FAILED)


def test_a_reference_no_number_can_solve_is_not_driven(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.path = PathReference(math.nan, 0.0, 0.0, 0.0, 20.0, 0.0)
    assert rig.tick(6).mode is Mode.SAFE_STOP


def test_a_vehicle_that_brakes_by_itself_ends_the_drive(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.is_watchdog_braking = True
    outcome = rig.tick()
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.VEHICLE_BRAKING)


def test_a_peer_with_another_catalogue_ends_the_drive(rig: Rig) -> None:
    rig.tick(3)
    rig.inbox.peer = PeerIdentity(dbc_hash=1, model_hash=None, counter=0, arrival_ns=0)
    outcome = rig.tick()
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.PEER_MISMATCH)


def test_a_safe_stop_outlasts_a_bus_that_works_again(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.state = CRUISING
    assert rig.tick(10).mode is Mode.SAFE_STOP


def test_a_reset_is_granted_to_a_standing_car_only(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    rig.tick(3)
    rig.vehicle.mission = ENGAGED._replace(is_reset_requested=True)
    rig.vehicle.state = CRUISING
    assert rig.tick(2).mode is Mode.SAFE_STOP
    rig.vehicle.state = CRUISING._replace(vx_mps=0.0, ds_m=0.0)
    assert rig.tick().mode is Mode.STANDBY
    rig.vehicle.mission = ENGAGED
    assert rig.tick().mode is Mode.NOMINAL


def test_the_end_of_a_mission_releases_the_pedals(rig: Rig) -> None:
    rig.tick(30)
    rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
    outcome = rig.tick(2)
    assert outcome.mode is Mode.STANDBY
    assert outcome.control.throttle == 0.0


def test_a_controller_that_leaves_says_so_with_a_safe_command(rig: Rig) -> None:
    rig.tick(30)
    rig.step.leave()
    rig.heard.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert rig.command.mode is Mode.SAFE_STOP
    assert rig.command.control.throttle == 0.0
    assert rig.command.control.brake_n > 0.0


def test_what_the_controller_does_is_what_the_vehicle_receives(rig: Rig) -> None:
    outcome = rig.tick(10)
    assert rig.command.control == pytest.approx(outcome.control, abs=2e-3)
    assert rig.heard.heartbeat is not None
    assert rig.heard.heartbeat.mode is outcome.mode
    assert rig.heard.peer is not None
    assert rig.heard.peer.model_hash == 7
    assert rig.heard.counts.lost == rig.heard.counts.crc_errors == 0


def test_a_state_that_dawdled_is_no_state(rig: Rig) -> None:
    rig.tick(10)
    rig.vehicle.stamped_late_ns = 60_000_000
    assert rig.tick().mode is Mode.HOLD_PLAN
    assert rig.heard.heartbeat is not None
    assert rig.heard.heartbeat.state_age_ns == pytest.approx(60_000_000, abs=100_000)
    outcome = rig.tick(2)
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)


def test_a_loop_whose_commands_take_too_long_to_show_is_not_driven(rig: Rig) -> None:
    for _ in range(20):
        newest = rig.inbox.state
        rig.vehicle.command_echo = None if newest is None else newest.counter
        assert rig.tick().mode is Mode.NOMINAL
    for _ in range(3):
        assert rig.inbox.state is not None
        rig.vehicle.command_echo = (rig.inbox.state.counter - 6) % 16
        outcome = rig.tick()
    assert outcome.mode is Mode.SAFE_STOP


def test_a_command_carries_the_counter_of_the_state_it_answers(rig: Rig) -> None:
    rig.tick(5)
    assert rig.inbox.state is not None
    assert rig.command.counter == rig.inbox.state.counter
    rig.vehicle.state = None
    rig.tick()
    assert rig.command.counter == rig.inbox.state.counter + 1


def test_skipped_periods_count_as_held_ones(rig: Rig) -> None:
    rig.tick(5)
    plan = rig.mpc.inputs.copy()
    rig.vehicle.state = None
    outcome = rig.tick(skipped=1)
    assert outcome.mode is Mode.HOLD_PLAN
    assert outcome.control.throttle == pytest.approx(plan[2][0], abs=1e-3)
    assert rig.tick(skipped=1).mode is Mode.SAFE_STOP


def test_a_hold_ends_after_two_ticks_with_the_shortest_horizon_too(
    mpc_of_three_stages: Mpc,
) -> None:
    with build_rig(mpc_of_three_stages) as rig:
        rig.tick(3)
        rig.vehicle.state = None
        assert rig.tick(2).mode is Mode.HOLD_PLAN
        assert rig.tick().mode is Mode.SAFE_STOP


def test_a_controller_that_starts_beside_a_braking_vehicle_stands_by(rig: Rig) -> None:
    rig.vehicle.is_watchdog_braking = True
    assert rig.tick(5).mode is Mode.STANDBY
    rig.vehicle.is_watchdog_braking = False
    assert rig.tick().mode is Mode.NOMINAL


def test_a_trouble_that_is_over_is_no_cause(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.state = None
    assert rig.tick().cause is StopCause.STATE_LOST
    rig.vehicle.state = CRUISING
    assert rig.tick().cause is StopCause.NONE
    rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
    rig.tick()
    rig.vehicle.mission = None
    assert rig.tick(30).cause is StopCause.NONE


def test_a_safe_stop_is_steered_along_the_path_while_the_car_is_seen(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.is_watchdog_braking = True
    rig.tick()
    rig.vehicle.path = STRAIGHT._replace(c0_m=1.5)
    outcome = rig.tick(10)
    assert outcome.mode is Mode.SAFE_STOP
    assert outcome.control.steer_rad > 0.02
    rig.vehicle.state = CRUISING._replace(vx_mps=2.0, ds_m=0.05)
    outcome = rig.tick(60)
    assert outcome.qp_iterations == 0
    assert outcome.control.steer_rad == 0.0


def test_frames_that_the_bus_does_not_take_show_in_the_heartbeat(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("full")

    rig.tick(2)
    with monkeypatch.context() as broken:
        broken.setattr(rig.controller_bus, "send", fail)
        rig.tick()
    rig.tick()
    assert rig.heard.heartbeat is not None
    assert rig.heard.heartbeat.faults & Fault.BUS_FAULT
    rig.tick()
    assert not rig.heard.heartbeat.faults & Fault.BUS_FAULT


def test_a_bus_that_cannot_be_read_stops_the_car(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("unplugged")

    rig.tick(2)
    monkeypatch.setattr(rig.controller_bus, "recv", fail)
    outcome = rig.tick()
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.BUS_FAILED)


def test_a_second_controller_on_the_bus_ends_the_drive(rig: Rig) -> None:
    rig.tick(3)
    ControllerOutbox(rig.vehicle_bus).send_command(CRUISE, Mode.NOMINAL, 9, 0)
    outcome = rig.tick()
    assert (outcome.mode, outcome.cause) == (Mode.SAFE_STOP, StopCause.SECOND_CONTROLLER)


@pytest.mark.parametrize("silent_periods", [1, 2])
def test_a_vehicle_that_stalled_and_comes_back_in_time_is_driven_on(
    rig: Rig, silent_periods: int
) -> None:
    def echo_what_was_heard() -> None:
        rig.vehicle.command_echo = rig.command.counter

    for _ in range(20):
        rig.tick()
        echo_what_was_heard()
    rig.vehicle.state = None
    for _ in range(silent_periods):
        assert rig.tick().mode is Mode.HOLD_PLAN
        echo_what_was_heard()
    rig.vehicle.state = CRUISING
    for _ in range(5):
        assert rig.tick().mode is Mode.NOMINAL
        echo_what_was_heard()


def test_a_vehicle_that_started_anew_is_learnt_anew(rig: Rig) -> None:
    rig.tick(10)
    rig.vehicle.mission = ENGAGED._replace(is_engaged=False)
    rig.vehicle.stamped_late_ns = 1_000_000_000
    assert rig.tick(5).mode is Mode.STANDBY
    rig.vehicle.mission = ENGAGED
    assert rig.tick().mode is Mode.NOMINAL
