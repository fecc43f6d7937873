"""Modes and events, the facts of a tick, and the age of what was received."""

from dataclasses import fields, replace

import pytest

from rt_controller.contract.faults import NO_FAULT, StopCause
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, Mode, PathReference
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    REFERENCE_MAX_TICKS,
    ROUND_TRIP_MAX_TICKS,
    STATE_MAX_AGE_NS,
    TIMING_SLACK_NS,
    SampleGrid,
    TransportDelay,
    is_fresh,
)
from rt_controller.safety.modes import BUS_CAUSES, TRANSITIONS, Event, classify, decide, next_mode
from rt_controller.safety.stop import Braking
from rt_controller.safety.tick import Estimate, Tick

DRIVING = [Mode.NOMINAL, Mode.LOW_SPEED, Mode.STANDSTILL, Mode.HOLD_PLAN]
LAWS = [
    (Event.PLANNED, Mode.NOMINAL),
    (Event.LOW_SPEED, Mode.LOW_SPEED),
    (Event.STANDSTILL, Mode.STANDSTILL),
]
ESTIMATED = ("alarm", "rejection", "speed_mps")
ALL_WELL = Tick(
    last_mode=Mode.NOMINAL,
    state=AT_REST,
    path=PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0),
    has_mission=True,
    is_engaged=True,
    law=Mode.NOMINAL,
    planned=NEUTRAL_INPUT,
)


def with_(facts, **fields):
    """The same tick with other fields of its own, or of its estimate."""
    of_estimate = {name: fields.pop(name) for name in ESTIMATED if name in fields}
    return replace(facts, estimate=facts.estimate._replace(**of_estimate), **fields)


HELD = with_(ALL_WELL, periods_held=1)
LOST = {"periods_held": 1, "state": None}


@pytest.mark.parametrize("mode", Mode)
def test_the_table_of_every_mode_and_event(mode):
    """Faults stop, only a reset leaves a stop, only a plan leads to NOMINAL."""
    found = {event: next_mode(mode, event) for event in Event}
    assert set(TRANSITIONS[mode]) == set(Event)
    assert found[Event.FAULT] is Mode.SAFE_STOP
    if mode is Mode.SAFE_STOP:
        assert {e for e in Event if found[e] is not Mode.SAFE_STOP} == {Event.RESET}
        assert found[Event.RESET] is Mode.STANDBY
    elif mode is Mode.STANDBY:
        waiting = (Event.IDLE, Event.HOLDING, Event.PLAN_LOST, Event.RESET)
        assert {found[event] for event in waiting} == {Mode.STANDBY}
    else:
        assert (found[Event.HOLDING], found[Event.PLAN_LOST]) == (Mode.HOLD_PLAN, Mode.SAFE_STOP)
    if mode is not Mode.NOMINAL:
        assert {e for e in Event if found[e] is Mode.NOMINAL} <= {Event.PLANNED}


@pytest.mark.parametrize(("event", "law"), LAWS)
@pytest.mark.parametrize("mode", [*DRIVING, Mode.STANDBY])
def test_the_mode_follows_the_law_that_made_the_input(mode, event, law):
    assert next_mode(mode, event) is law
    assert classify(with_(with_(ALL_WELL, law=law), last_mode=mode)) == (event, StopCause.NONE)
    assert law.drives


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("cause", BUS_CAUSES)
def test_a_bus_fault_is_a_fault_in_every_mode(mode, cause):
    assert classify(with_(with_(ALL_WELL, bus_fault=cause), last_mode=mode)) == (Event.FAULT, cause)


@pytest.mark.parametrize(
    ("facts", "cause", "in_standby"),
    [
        (with_(ALL_WELL, is_stop_requested=True), StopCause.STOP_REQUESTED, None),
        (with_(ALL_WELL, is_vehicle_braking=True), StopCause.VEHICLE_BRAKING, Event.IDLE),
    ],
)
def test_a_stop_request_and_a_braking_vehicle_are_faults_except_in_standby(
    facts, cause, in_standby
):
    for mode in (*DRIVING, Mode.SAFE_STOP):
        assert classify(with_(facts, last_mode=mode)) == (Event.FAULT, cause)
    event, reason = classify(with_(facts, last_mode=Mode.STANDBY))
    assert event is not Event.FAULT
    if in_standby is not None:
        assert (event, reason) == (in_standby, StopCause.NONE)


@pytest.mark.parametrize(
    ("facts", "event", "cause"),
    [
        (ALL_WELL, Event.PLANNED, StopCause.NONE),
        (with_(ALL_WELL, is_engaged=False), Event.IDLE, StopCause.NONE),
        (with_(ALL_WELL, has_mission=False), Event.PLAN_LOST, StopCause.MISSION_LOST),
        (HELD, Event.HOLDING, StopCause.SOLVER_FAILED),
        (with_(HELD, path=None), Event.HOLDING, StopCause.REFERENCE_LOST),
        (with_(HELD, state=None), Event.HOLDING, StopCause.STATE_LOST),
        (with_(HELD, state=None, state_loss=StopCause.BUS_OFF), Event.HOLDING, StopCause.BUS_OFF),
        (with_(HELD, state_loss=StopCause.BUS_OFF), Event.HOLDING, StopCause.SOLVER_FAILED),
        (
            with_(HELD, path=None, has_invalid_path=True),
            *(Event.HOLDING, StopCause.REFERENCE_INVALID),
        ),
        (
            with_(HELD, state=None, has_invalid_state=True),
            *(Event.HOLDING, StopCause.STATE_INVALID),
        ),
        (with_(HELD, planned=None), Event.PLAN_LOST, StopCause.SOLVER_FAILED),
        (with_(HELD, periods_held=2), Event.HOLDING, StopCause.SOLVER_FAILED),
        (with_(HELD, periods_held=3), Event.PLAN_LOST, StopCause.SOLVER_FAILED),
    ],
)
@pytest.mark.parametrize("mode", DRIVING)
def test_the_event_of_a_driven_tick_names_the_missing_part(mode, facts, event, cause):
    assert classify(with_(facts, last_mode=mode)) == (event, cause)


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    ("speed_mps", "is_standing"), [(0.27, True), (0.3, False), (20.0, False), (-0.5, False)]
)
def test_a_reset_is_granted_in_safe_stop_when_the_car_stands(mode, speed_mps, is_standing):
    facts = with_(ALL_WELL, is_reset_requested=True, speed_mps=speed_mps, last_mode=mode)
    assert (classify(facts)[0] is Event.RESET) == (mode is Mode.SAFE_STOP and is_standing)


def test_a_safe_stop_keeps_the_cause_that_it_began_with():
    lost = with_(HELD, planned=None, state=None)
    mode, cause = decide(with_(lost, last_mode=Mode.HOLD_PLAN), StopCause.STATE_LOST)
    assert (mode, cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)
    later = with_(ALL_WELL, is_vehicle_braking=True)
    assert decide(with_(later, last_mode=mode), cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)


@pytest.mark.parametrize(
    ("last", "before", "facts", "mode", "cause"),
    [
        (Mode.HOLD_PLAN, StopCause.STATE_LOST, {}, Mode.NOMINAL, StopCause.NONE),
        (Mode.STANDBY, StopCause.NONE, {"has_mission": False}, Mode.STANDBY, StopCause.NONE),
        (
            *(Mode.NOMINAL, StopCause.NONE, {"alarm": StopCause.YAW_RATE_IMPLAUSIBLE}),
            *(Mode.SAFE_STOP, StopCause.YAW_RATE_IMPLAUSIBLE),
        ),
        (
            *(Mode.NOMINAL, StopCause.NONE),
            {"periods_held": 1, "rejection": StopCause.LATERAL_ERROR_IMPLAUSIBLE},
            *(Mode.HOLD_PLAN, StopCause.LATERAL_ERROR_IMPLAUSIBLE),
        ),
        (
            *(Mode.STANDBY, StopCause.NONE),
            {"periods_held": 1, "rejection": StopCause.NOT_ENGAGED, "planned": None},
            *(Mode.STANDBY, StopCause.NOT_ENGAGED),
        ),
        (
            *(Mode.NOMINAL, StopCause.NONE, {**LOST, "has_conflict": True}),
            *(Mode.HOLD_PLAN, StopCause.STATE_CONFLICT),
        ),
        (
            *(Mode.NOMINAL, StopCause.NONE, {**LOST, "is_answered": False}),
            *(Mode.HOLD_PLAN, StopCause.COMMANDS_UNANSWERED),
        ),
    ],
)
def test_the_next_mode_has_the_cause_that_its_tick_names(last, before, facts, mode, cause):
    assert decide(with_(ALL_WELL, last_mode=last, **facts), before) == (mode, cause)


@pytest.mark.parametrize("fact", ["is_answered", "is_wheel_matched"])
@pytest.mark.parametrize("is_true", [False, True])
@pytest.mark.parametrize("mode", [*DRIVING, Mode.STANDBY])
def test_a_drive_begins_when_commands_are_accepted_and_at_the_wheel(mode, is_true, fact):
    event, _ = classify(with_(ALL_WELL, last_mode=mode, **{fact: is_true}))
    is_idle = mode is Mode.STANDBY and not is_true
    assert event is (Event.IDLE if is_idle else Event.PLANNED)


def test_nothing_is_received_planned_or_decided_in_a_new_tick():
    tick = Tick()
    values = {field.name: getattr(tick, field.name) for field in fields(tick)}
    true = {name for name, value in values.items() if value is True}
    assert true == {"is_answered", "is_wheel_matched"}
    assert (tick.periods, tick.late_ticks, tick.periods_held) == (1, 0, 0)
    assert (tick.qp_iterations, tick.qp_ns, tick.curvature_per_m) == (0, 0, 0.0)
    assert {tick.mode, tick.last_mode, tick.law} == {Mode.STANDBY}
    assert (tick.cause, tick.bus_fault) == (StopCause.NONE, StopCause.NONE)
    assert (tick.state_loss, tick.faults) == (StopCause.STATE_LOST, NO_FAULT)
    assert (tick.control, tick.limits) == (NEUTRAL_INPUT, INPUT_LIMITS)
    nothing = Estimate(None, 0.0, None, None, False, False, None, StopCause.NONE, StopCause.NONE)
    assert tick.estimate == nothing == Estimate()
    received = (tick.state, tick.path, tick.preview, tick.feedback, tick.applied, tick.planned)
    assert received == (None,) * 6
    assert not hasattr(tick, "__dict__")


def test_a_mode_says_whether_the_car_was_driven_and_is_stopping():
    for mode in Mode:
        tick = Tick(last_mode=mode)
        assert tick.is_driven == (mode is not Mode.STANDBY)
        assert tick.is_stopping == (mode is Mode.SAFE_STOP)


def test_a_braking_is_scaled_by_the_force_of_the_car():
    usual = Braking(20.0, 150.0)
    assert usual.scaled(0.5) == (10.0, 75.0)
    assert usual.scaled(2.0) == (40.0, 300.0)
    assert usual.scaled(1.0) == usual


WRAP_NS = 6_553_600_000


@pytest.mark.parametrize(
    ("age_ns", "fresh"),
    [
        (0, True),
        (100, True),
        (100 + TIMING_SLACK_NS, True),
        (101 + TIMING_SLACK_NS, False),
        (-1, False),
    ],
)
def test_data_is_fresh_up_to_its_maximum_age_and_not_before_its_arrival(age_ns, fresh):
    now_ns = 10**9
    assert is_fresh(now_ns - age_ns, now_ns, max_age_ns=100) is fresh


@pytest.mark.parametrize(
    ("max_age_ns", "periods"), [(STATE_MAX_AGE_NS, 2), (REFERENCE_MAX_AGE_NS, 3)]
)
def test_states_and_paths_are_fresh_for_so_many_periods(max_age_ns, periods):
    for age, expected in ((periods + 0.49, True), (periods + 0.51, False)):
        assert is_fresh(0, round(age * 25_000_000), max_age_ns) is expected


def test_limits_in_ticks_are_those_of_the_documentation():
    assert (REFERENCE_MAX_TICKS, ROUND_TRIP_MAX_TICKS) == (3, 4)


def stamp(sent_ns, clock_offset_ns=123_456_789):
    """The sender's own clock, with the resolution and the range of the frame."""
    return (sent_ns + clock_offset_ns) % WRAP_NS // 100_000 * 100_000


def test_a_constant_delay_is_not_measured():
    delay = TransportDelay(WRAP_NS)
    for k in range(1000):  # the stamp wraps around several times
        sent_ns = k * PERIOD_NS
        assert delay.measure(sent_ns + 7_000_000, stamp(sent_ns)) < 300_000


def test_a_delay_beyond_the_fastest_message_is_measured_in_full():
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        delay.measure(k * PERIOD_NS + 2_000_000, stamp(k * PERIOD_NS))
    for k, late_ns in enumerate((40_000_000, 400_000_000, 1_000_000_000), start=100):
        extra_ns = delay.measure(k * PERIOD_NS + late_ns, stamp(k * PERIOD_NS))
        assert extra_ns == pytest.approx(late_ns - 2_000_000, abs=2_000_000)  # fades by 1 ms/s


def test_two_faster_messages_in_a_row_become_the_fastest():
    delay = TransportDelay(WRAP_NS)
    delay.measure(30_000_000, stamp(0))
    assert delay.measure(PERIOD_NS + 1_000_000, stamp(PERIOD_NS)) == 0
    assert delay.measure(2 * PERIOD_NS + 3_000_000, stamp(2 * PERIOD_NS)) == 0
    late_ns = delay.measure(3 * PERIOD_NS + 30_000_000, stamp(3 * PERIOD_NS))
    assert late_ns == pytest.approx(27_000_000, abs=300_000)
    assert delay.measure(4 * PERIOD_NS + 1_000_000, stamp(4 * PERIOD_NS)) == 0


@pytest.mark.parametrize(
    ("on_the_way_ns", "extra_ns"),
    [
        ([1000, 900, 1500], 500),  # one faster message does not count
        ([1000, 1000, 900, 1500], 500),
        ([1000, 900, 1200, 900, 1500], 500),  # nor do two with another one between them
        ([1000, 900, 800, 1500], 600),  # of two it is the slower one
        ([1000, 800, 900, 1500], 600),
        ([1000, 900, 900, 850, 1500], 600),  # a third one that is still faster is a first one
        ([1000, 900, 800, 800, 1500], 700),
    ],
)
def test_a_delay_is_counted_from_the_fastest_messages_to_the_nanosecond(on_the_way_ns, extra_ns):
    delay = TransportDelay(WRAP_NS)
    found_ns = [delay.measure(10**9, 10**9 - each_ns) for each_ns in on_the_way_ns]
    assert found_ns[-1] == extra_ns


def test_a_message_that_was_sent_after_its_noted_arrival_delays_no_later_one():
    """A process was frozen for 300 ms after it had read its clock, before it read the bus."""
    delay = TransportDelay(WRAP_NS)
    for k in range(100):
        arrival_ns = k * PERIOD_NS + (-290_000_000 if k == 50 else 2_000_000)
        assert delay.measure(arrival_ns, stamp(k * PERIOD_NS)) < 1_000_000


@pytest.mark.parametrize("drift", [-500e-6, -100e-6, 100e-6, 500e-6])
def test_clock_drift_is_not_measured_as_a_delay(drift):
    delay = TransportDelay(WRAP_NS)
    for k in range(40 * 600):  # ten minutes
        sent_ns = k * PERIOD_NS
        assert delay.measure(sent_ns + 2_000_000, stamp(round(sent_ns * (1 + drift)))) < 1_000_000


@pytest.mark.parametrize(
    ("gap_ns", "expected_ns"), [(10**9, 39_000_000), (10**9 + 1, 0), (4 * 10**9, 0)]
)
def test_after_a_gap_of_more_than_a_second_or_a_reset_the_next_message_is_the_fastest(
    gap_ns, expected_ns
):
    delay = TransportDelay(WRAP_NS)
    delay.measure(0, 0)
    assert delay.measure(gap_ns, gap_ns - 40_000_000) == pytest.approx(expected_ns, abs=1)
    delay.reset()
    assert delay.measure(gap_ns + 30_000_000, 0) == 0


@pytest.mark.parametrize(("share", "measured"), [(0.4, 0.4), (0.5, 0.5), (0.6, 0.0)])
def test_more_than_half_a_wrap_is_a_message_that_was_faster(share, measured):
    delay = TransportDelay(WRAP_NS)
    delay.measure(10**9, 0)
    assert delay.measure(10**9, -round(share * WRAP_NS)) == round(measured * WRAP_NS)


def sample_times(stamps_ms, counters=None):
    """What a grid finds of these stamps, in ms."""
    grid = SampleGrid(WRAP_NS)
    counters = counters or range(len(stamps_ms))
    found = [
        grid.measure(round(1e6 * stamp_ms) % WRAP_NS, counter % 128)
        for stamp_ms, counter in zip(stamps_ms, counters, strict=True)
    ]
    return [(1e3 * late_s, longer_s and 1e3 * longer_s) for late_s, longer_s in found]


def test_a_sample_is_late_behind_the_mean_of_those_before_it():
    period_ms = PERIOD_NS / 1e6
    regular = [period_ms * k for k in range(1000)]  # the stamp wraps around
    assert set(sample_times(regular)) == {(0.0, 0.0)}
    late = [*regular]
    late[400] += 10.0
    found = sample_times(late)
    assert found[400] == pytest.approx((10.0, 10.0))
    assert found[401] == pytest.approx((0.0, -10.0), abs=0.3)
    lost = range(400, 403)
    kept = [k for k in range(1000) if k not in lost]
    found = sample_times([late[k] for k in kept], kept)
    assert set(found) == {(0.0, 0.0)}
    fast = sample_times([1.001 * stamp_ms for stamp_ms in regular])
    assert max(abs(late_ms) for late_ms, _ in fast) < 1.1
    for useless in ([7.0] * 1000, [1000.0 * k for k in range(1000)]):
        assert set(sample_times(useless)) == {(0.0, 0.0)}


def test_after_a_lost_sample_the_interval_is_not_known():
    period_ms = PERIOD_NS / 1e6
    found = sample_times([0.0, period_ms, 3.0 * period_ms + 5.0], [0, 1, 3])
    assert found[2] == (pytest.approx(5.0), None)
