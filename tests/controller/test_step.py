"""What a control step sends, with missing data, failed solves and faults of the bus."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scripted_vehicle import CRUISING, ENGAGED, STRAIGHT, VALID_NS, Rig, build_rig, mode_and_cause

from rt_controller.bus.identity import DISENGAGED_FRAMES
from rt_controller.bus.messages import CONTROLLER_IDENTITY, STATE, Mission
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import AT_REST, ControlInput, Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_NS, PERIOD_S
from rt_controller.control.program import SolveStatus

NOT_ENGAGED = ENGAGED._replace(is_engaged=False)


def test_a_missing_state_holds_the_plan_for_two_ticks_and_then_stops(rig):
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


@pytest.mark.parametrize(
    ("sent", "objection"),
    [
        ({"state": CRUISING._replace(ey_m=math.nan)}, "STATE_B: LateralError: expected a value"),
        ({"is_valid": False}, "STATE_A: Valid: expected 1, found 0"),
    ],
)
def test_a_state_with_nan_or_marked_invalid_counts_as_missing(rig, sent, objection):
    rig.tick(3)
    for name, value in sent.items():
        setattr(rig.vehicle, name, value)
    assert rig.tick().mode is Mode.HOLD_PLAN
    assert mode_and_cause(rig.tick(2)) == (Mode.SAFE_STOP, StopCause.STATE_INVALID)
    assert rig.heartbeat.faults == Fault.STATE_STALE | Fault.STATE_INVALID
    assert rig.inbox.explain_out_of_range(STATE).startswith(objection)
    assert all(math.isfinite(value) for value in rig.command.content.control)


@pytest.mark.parametrize("status", [s for s in SolveStatus if s is not SolveStatus.SOLVED])
def test_a_failed_solve_holds_the_plan_and_then_stops(rig, monkeypatch, status):
    rig.tick(3)
    plan = rig.mpc.inputs.copy()
    monkeypatch.setattr(rig.mpc, "plan", lambda *_: status)
    result = rig.tick()
    assert result.mode is Mode.HOLD_PLAN
    assert result.control == pytest.approx(plan[1], abs=1e-3)
    assert mode_and_cause(rig.tick(2)) == (Mode.SAFE_STOP, StopCause.SOLVER_FAILED)


def test_the_end_of_a_mission_releases_the_pedals(rig):
    rig.tick(30)
    rig.vehicle.mission = NOT_ENGAGED
    assert rig.tick(DISENGAGED_FRAMES - 1).mode is Mode.NOMINAL
    result = rig.tick()
    assert result.mode is Mode.STANDBY
    assert result.control.throttle == 0.0
    assert rig.tick(60).qp_iterations == 0
    assert rig.command.content.control == (0.0, 0.0, 0.0)


def test_the_vehicle_receives_the_result_of_the_step(rig):
    result = rig.tick(10)
    assert result.mode is Mode.NOMINAL
    assert result.qp_iterations > 0
    assert result.control.steer_rad < 0.0  # the car is left of its path and heads to the left
    assert rig.command.content.control == pytest.approx(result.control, abs=2e-3)
    assert rig.heartbeat.mode is result.mode
    identity = rig.received.newest(CONTROLLER_IDENTITY)
    assert identity.content.model_hash == 7
    assert rig.received.counts.counter_gap_frames == rig.received.counts.crc_errors == 0


def test_a_delayed_state_counts_as_missing(rig):
    rig.tick(10)
    rig.vehicle.stamped_late_ns = 60_000_000
    assert rig.tick().mode is Mode.HOLD_PLAN
    assert rig.heartbeat.state_age_ns == pytest.approx(60_000_000, abs=100_000)
    assert mode_and_cause(rig.tick(2)) == (Mode.SAFE_STOP, StopCause.STATE_LOST)


def test_a_command_carries_the_counter_of_the_state_it_answers(rig):
    rig.tick(5)
    newest = rig.inbox.newest(STATE)
    assert rig.command.counter == newest.counter
    rig.vehicle.state = None
    rig.tick()
    assert rig.command.counter == newest.counter + 1


def test_skipped_periods_count_as_held_ones(rig):
    rig.tick(5)
    plan = rig.mpc.inputs.copy()
    rig.vehicle.state = None
    result = rig.tick(skipped=1)
    assert result.mode is Mode.HOLD_PLAN
    assert result.control.throttle == pytest.approx(plan[2][0], abs=1e-3)
    assert rig.tick(skipped=1).mode is Mode.SAFE_STOP


@pytest.mark.parametrize(
    ("missing", "used_ticks", "held_ticks", "cause"),
    [
        ("path", 3, 2, StopCause.REFERENCE_LOST),
        ("mission", VALID_NS // PERIOD_NS, 0, StopCause.MISSION_LOST),
    ],
)
def test_a_path_is_valid_for_three_periods_and_a_mission_for_its_time(
    rig, missing, used_ticks, held_ticks, cause
):
    rig.tick(3)
    setattr(rig.vehicle, missing, None)
    assert rig.tick(used_ticks).mode is Mode.NOMINAL
    for _ in range(held_ticks):
        assert rig.tick().mode is Mode.HOLD_PLAN
    assert mode_and_cause(rig.tick()) == (Mode.SAFE_STOP, cause)


FLAGGED_NS, STOPPED_NS = 50_000_000, 125_000_000


@pytest.mark.parametrize("is_damaged", [False, True])
def test_a_lost_state_is_flagged_after_50_ms_and_stops_the_car_after_125_ms_at_most(
    mpc_of_session, monkeypatch, is_damaged
):
    """Also one with a damaged frame."""
    with build_rig(mpc_of_session) as rig:
        assert rig.tick(20).mode is Mode.NOMINAL
        last_state_ns, receive = rig.clock.now_ns(), rig.controller_bus.recv

        def damage(timeout=None):
            frame = receive(timeout)
            if frame is not None:
                frame.data[-1] ^= 1
            return frame

        if is_damaged:
            monkeypatch.setattr(rig.controller_bus, "recv", damage)
        else:
            rig.vehicle.state = None
        flagged_ns, stopped_ns = [], []
        for _ in range(8):
            result = rig.tick()
            after_ns = rig.clock.now_ns() - last_state_ns
            if rig.heartbeat.faults & Fault.STATE_STALE:
                flagged_ns.append(after_ns)
            if rig.command.content.mode is Mode.SAFE_STOP:
                stopped_ns.append(after_ns)
                assert result.control.throttle == 0.0
        assert flagged_ns[0] <= FLAGGED_NS
        assert stopped_ns[0] <= STOPPED_NS


speeds = st.sampled_from([CRUISING, CRUISING._replace(vx_mps=0.0), CRUISING._replace(ey_m=8.0)])
broken = st.sampled_from([None, CRUISING._replace(vy_mps=math.nan)])
states = st.one_of(speeds, speeds, broken)
paths = st.sampled_from(
    [STRAIGHT, STRAIGHT._replace(c0_m=3.0, c1=0.3), STRAIGHT._replace(v_mps=0.0), None]
)
missions = st.one_of(
    st.builds(Mission, st.booleans(), st.booleans(), st.just(1), st.just(VALID_NS)), st.none()
)


@settings(max_examples=30)
@given(st.lists(st.tuples(states, paths, missions), min_size=1, max_size=30))
def test_every_command_is_within_bounds_slew_limited_and_on_one_pedal(mpc_of_session, script):
    with build_rig(mpc_of_session) as rig:
        held = 0
        for rig.vehicle.state, rig.vehicle.path, rig.vehicle.mission in script:
            previous, was = rig.step.last.control, rig.step.last.mode
            result = rig.tick()
            assert_within_limits(result.control, previous)
            held = held + 1 if result.mode is Mode.HOLD_PLAN else 0
            assert held <= HOLD_PLAN_TICKS
            if result.mode is Mode.SAFE_STOP:
                assert result.control.throttle == 0.0
            if was is Mode.SAFE_STOP and result.mode is not Mode.SAFE_STOP:
                assert rig.vehicle.mission.is_reset_requested


def assert_within_limits(control: ControlInput, previous: ControlInput) -> None:
    rate = INPUT_LIMITS.rate_per_s
    for value, low, high in zip(control, INPUT_LIMITS.lower, INPUT_LIMITS.upper, strict=True):
        assert math.isfinite(value)
        assert low <= value <= high
    assert control.throttle == 0.0 or control.brake_n == 0.0
    assert control.throttle - previous.throttle <= rate.throttle * PERIOD_S + 1e-9
    # A brake force below one thousandth of the pedal's travel is sent as 0.
    assert abs(control.brake_n - previous.brake_n) <= rate.brake_n * PERIOD_S + 0.15
    assert abs(control.steer_rad - previous.steer_rad) <= rate.steer_rad * PERIOD_S + 1e-9


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
