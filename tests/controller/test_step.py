"""What the controller does when the bus, the solver or the vehicle does not do its part."""

import math

import pytest
from scripted_vehicle import CRUISING, ENGAGED, VALID_NS, Rig

from rt_controller.bus.snapshot import PeerIdentity
from rt_controller.contract.signals import Mode, PathReference
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.control.solver import SolveStatus
from rt_controller.step import StopCause


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
    rig.step.stop()
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
