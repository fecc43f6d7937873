"""What a control step sends, with missing data, failed solves and faults of the bus."""

import math

import pytest
from scripted_vehicle import CRUISING, ENGAGED, VALID_NS, Rig, build_rig, mode_and_cause

from rt_controller.bus.identity import DISENGAGED_FRAMES
from rt_controller.bus.messages import CONTROLLER_IDENTITY, STATE
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_NS
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus

NOT_ENGAGED = ENGAGED._replace(is_engaged=False)


def test_an_engaged_mission_and_a_fresh_state_give_mode_nominal(rig: Rig) -> None:
    result = rig.tick()
    assert result.mode is Mode.NOMINAL
    assert result.qp_iterations > 0
    assert rig.command.content.mode is Mode.NOMINAL
    assert (
        rig.command.content.control.steer_rad < 0.0
    )  # the car is left of its path and heads to the left


def test_without_an_engaged_mission_the_controller_stands_by(rig: Rig) -> None:
    rig.vehicle.mission = NOT_ENGAGED
    result = rig.tick(5)
    assert result.mode is Mode.STANDBY
    assert rig.command.content.control == (0.0, 0.0, 0.0)
    assert result.qp_iterations == 0


def test_a_missing_state_holds_the_plan_for_two_ticks_and_then_stops(rig: Rig) -> None:
    rig.tick(5)
    plan = rig.mpc.inputs.copy()
    rig.vehicle.state = None
    for held in range(1, HOLD_PLAN_TICKS + 1):
        result = rig.tick()
        assert result.mode is Mode.HOLD_PLAN
        assert result.control == pytest.approx(plan[held], abs=1e-3)
    result = rig.tick()
    assert result.mode is Mode.SAFE_STOP
    assert result.cause is StopCause.STATE_LOST
    assert result.control.throttle == 0.0
    assert result.control.brake_n > 0.0


@pytest.mark.parametrize("field", CRUISING._fields)
def test_a_state_with_nan_counts_as_missing(rig: Rig, field: str) -> None:
    rig.tick(3)
    rig.vehicle.state = CRUISING._replace(**{field: math.nan})
    assert rig.tick().mode is Mode.HOLD_PLAN
    assert rig.inbox.counts.out_of_range > 0
    assert rig.tick(2).mode is Mode.SAFE_STOP
    assert all(math.isfinite(value) for value in rig.command.content.control)


def test_a_state_marked_invalid_counts_as_missing(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.is_valid = False
    assert rig.tick(3).mode is Mode.SAFE_STOP
    assert rig.heartbeat.faults == Fault.STATE_STALE | Fault.STATE_INVALID
    assert rig.step.last.cause is StopCause.STATE_INVALID
    assert rig.inbox.explain_out_of_range(STATE) == "STATE_A: Valid: expected 1, found 0"


def test_a_path_is_valid_for_three_periods(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.path = None
    assert rig.tick(3).mode is Mode.NOMINAL
    assert rig.tick(2).mode is Mode.HOLD_PLAN
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.REFERENCE_LOST)


def test_a_mission_that_is_no_longer_valid_stops_the_car(rig: Rig) -> None:
    rig.tick(3)
    rig.vehicle.mission = None
    assert rig.tick(VALID_NS // PERIOD_NS).mode is Mode.NOMINAL
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, StopCause.MISSION_LOST)


@pytest.mark.parametrize("status", [s for s in SolveStatus if s is not SolveStatus.SOLVED])
def test_a_failed_solve_holds_the_plan_and_then_stops(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, status: SolveStatus
) -> None:
    rig.tick(3)
    plan = rig.mpc.inputs.copy()
    monkeypatch.setattr(rig.mpc, "plan", lambda *_: status)
    result = rig.tick()
    assert result.mode is Mode.HOLD_PLAN
    assert result.control == pytest.approx(plan[1], abs=1e-3)
    assert mode_and_cause(rig.tick(2)) == (Mode.SAFE_STOP, StopCause.SOLVER_FAILED)


def test_the_end_of_a_mission_releases_the_pedals(rig: Rig) -> None:
    rig.tick(30)
    rig.vehicle.mission = NOT_ENGAGED
    assert rig.tick(DISENGAGED_FRAMES - 1).mode is Mode.NOMINAL
    result = rig.tick()
    assert result.mode is Mode.STANDBY
    assert result.control.throttle == 0.0


def test_the_vehicle_receives_the_result_of_the_step(rig: Rig) -> None:
    result = rig.tick(10)
    assert rig.command.content.control == pytest.approx(result.control, abs=2e-3)
    assert rig.heartbeat.mode is result.mode
    identity = rig.received.newest(CONTROLLER_IDENTITY)
    assert identity is not None
    assert identity.content.model_hash == 7
    assert rig.received.counts.counter_gap_frames == rig.received.counts.crc_errors == 0


def test_a_delayed_state_counts_as_missing(rig: Rig) -> None:
    rig.tick(10)
    rig.vehicle.stamped_late_ns = 60_000_000
    assert rig.tick().mode is Mode.HOLD_PLAN
    assert rig.heartbeat.state_age_ns == pytest.approx(60_000_000, abs=100_000)
    assert mode_and_cause(rig.tick(2)) == (Mode.SAFE_STOP, StopCause.STATE_LOST)


def test_a_round_trip_of_too_many_periods_stops_the_car(rig: Rig) -> None:
    for _ in range(20):
        newest = rig.inbox.newest(STATE)
        rig.vehicle.command_echo = None if newest is None else newest.counter
        assert rig.tick().mode is Mode.NOMINAL
    for _ in range(3):
        newest = rig.inbox.newest(STATE)
        assert newest is not None
        rig.vehicle.command_echo = (newest.counter - 6) % 16
        result = rig.tick()
    assert result.mode is Mode.SAFE_STOP


def test_a_command_carries_the_counter_of_the_state_it_answers(rig: Rig) -> None:
    rig.tick(5)
    newest = rig.inbox.newest(STATE)
    assert newest is not None
    assert rig.command.counter == newest.counter
    rig.vehicle.state = None
    rig.tick()
    assert rig.command.counter == newest.counter + 1


def test_skipped_periods_count_as_held_ones(rig: Rig) -> None:
    rig.tick(5)
    plan = rig.mpc.inputs.copy()
    rig.vehicle.state = None
    result = rig.tick(skipped=1)
    assert result.mode is Mode.HOLD_PLAN
    assert result.control.throttle == pytest.approx(plan[2][0], abs=1e-3)
    assert rig.tick(skipped=1).mode is Mode.SAFE_STOP


def test_with_the_shortest_horizon_a_plan_is_held_for_two_ticks_too(
    mpc_of_three_stages: Mpc,
) -> None:
    with build_rig(mpc_of_three_stages) as rig:
        rig.tick(3)
        rig.vehicle.state = None
        assert rig.tick(2).mode is Mode.HOLD_PLAN
        assert rig.tick().mode is Mode.SAFE_STOP


@pytest.mark.parametrize("silent_periods", [1, 2])
def test_after_a_short_stall_of_the_vehicle_the_plan_is_followed_again(
    rig: Rig, silent_periods: int
) -> None:
    rig.tick(20)
    rig.vehicle.state = None
    for _ in range(silent_periods):
        assert rig.tick().mode is Mode.HOLD_PLAN
    rig.vehicle.state = CRUISING
    for _ in range(5):
        assert rig.tick().mode is Mode.NOMINAL
        assert rig.step.last.cause is StopCause.NONE


def test_after_a_restart_of_the_vehicle_its_delay_is_measured_from_zero(rig: Rig) -> None:
    rig.tick(10)
    rig.vehicle.mission = NOT_ENGAGED
    rig.vehicle.stamped_late_ns = 1_000_000_000
    assert rig.tick(5).mode is Mode.STANDBY
    rig.vehicle.mission = ENGAGED
    assert rig.tick().mode is Mode.NOMINAL
