"""The mode table, mode x event; and the events, from the values of a tick."""

import itertools
from dataclasses import replace
from typing import Any

import pytest

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, Mode, PathReference
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.safety.modes import (
    BUS_CAUSES,
    STANDING_MPS,
    TRANSITIONS,
    Event,
    classify,
    decide,
    next_mode,
)
from rt_controller.safety.tick import Tick

ALL = list(itertools.product(Mode, Event))
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


def with_(facts: Tick, **fields: Any) -> Tick:
    """The same tick with other fields of its own, or of its estimate."""
    of_estimate = {name: fields.pop(name) for name in ESTIMATED if name in fields}
    return replace(facts, estimate=facts.estimate._replace(**of_estimate), **fields)


HELD = with_(ALL_WELL, periods_held=1)


def test_the_table_has_one_entry_for_every_mode_and_event() -> None:
    assert set(TRANSITIONS) == set(Mode)
    assert all(set(row) == set(Event) for row in TRANSITIONS.values())


@pytest.mark.parametrize("mode", Mode)
def test_a_fault_leads_from_every_mode_to_safe_stop(mode: Mode) -> None:
    assert next_mode(mode, Event.FAULT) is Mode.SAFE_STOP


@pytest.mark.parametrize("event", [e for e in Event if e is not Event.RESET])
def test_only_an_explicit_reset_leaves_safe_stop(event: Event) -> None:
    assert next_mode(Mode.SAFE_STOP, event) is Mode.SAFE_STOP
    assert next_mode(Mode.SAFE_STOP, Event.RESET) is Mode.STANDBY


@pytest.mark.parametrize(("mode", "event"), [(m, e) for m, e in ALL if e is not Event.PLANNED])
def test_only_a_new_plan_leads_to_nominal(mode: Mode, event: Event) -> None:
    if mode is not Mode.NOMINAL:
        assert next_mode(mode, event) is not Mode.NOMINAL


@pytest.mark.parametrize(("event", "law"), LAWS)
@pytest.mark.parametrize("mode", [*DRIVING, Mode.STANDBY])
def test_the_mode_follows_the_law_that_made_the_input(mode: Mode, event: Event, law: Mode) -> None:
    assert next_mode(mode, event) is law
    assert classify(with_(with_(ALL_WELL, law=law), last_mode=mode)) == (event, StopCause.NONE)
    assert law.drives


@pytest.mark.parametrize("mode", DRIVING)
def test_without_a_new_plan_the_last_one_is_held_and_then_the_car_stopped(mode: Mode) -> None:
    assert next_mode(mode, Event.HOLDING) is Mode.HOLD_PLAN
    assert next_mode(mode, Event.PLAN_LOST) is Mode.SAFE_STOP


@pytest.mark.parametrize("event", [Event.IDLE, Event.HOLDING, Event.PLAN_LOST, Event.RESET])
def test_without_a_plan_standby_goes_on(event: Event) -> None:
    assert next_mode(Mode.STANDBY, event) is Mode.STANDBY


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("cause", BUS_CAUSES)
def test_a_bus_fault_is_a_fault_in_every_mode(mode: Mode, cause: StopCause) -> None:
    assert classify(with_(with_(ALL_WELL, bus_fault=cause), last_mode=mode)) == (Event.FAULT, cause)


@pytest.mark.parametrize(
    ("facts", "cause"),
    [
        (with_(ALL_WELL, is_stop_requested=True), StopCause.STOP_REQUESTED),
        (with_(ALL_WELL, is_vehicle_braking=True), StopCause.VEHICLE_BRAKING),
    ],
)
def test_a_stop_request_and_a_braking_vehicle_are_faults_except_in_standby(
    facts: Tick, cause: StopCause
) -> None:
    for mode in (*DRIVING, Mode.SAFE_STOP):
        assert classify(with_(facts, last_mode=mode)) == (Event.FAULT, cause)
    assert classify(with_(facts, last_mode=Mode.STANDBY))[0] is not Event.FAULT


@pytest.mark.parametrize(
    ("facts", "event", "cause"),
    [
        (ALL_WELL, Event.PLANNED, StopCause.NONE),
        (with_(ALL_WELL, is_engaged=False), Event.IDLE, StopCause.NONE),
        (with_(ALL_WELL, has_mission=False), Event.PLAN_LOST, StopCause.MISSION_LOST),
        (HELD, Event.HOLDING, StopCause.SOLVER_FAILED),
        (with_(HELD, path=None), Event.HOLDING, StopCause.REFERENCE_LOST),
        (with_(HELD, state=None), Event.HOLDING, StopCause.STATE_LOST),
        (
            with_(HELD, state=None, state_loss=StopCause.BUS_OFF),
            Event.HOLDING,
            StopCause.BUS_OFF,
        ),
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
        (
            with_(HELD, periods_held=HOLD_PLAN_TICKS + 1),
            *(Event.PLAN_LOST, StopCause.SOLVER_FAILED),
        ),
    ],
)
@pytest.mark.parametrize("mode", DRIVING)
def test_the_event_of_a_driven_tick_names_the_missing_part(
    mode: Mode, facts: Tick, event: Event, cause: StopCause
) -> None:
    assert classify(with_(facts, last_mode=mode)) == (event, cause)


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("is_standing", [False, True])
def test_a_reset_is_granted_in_safe_stop_when_the_car_stands(mode: Mode, is_standing: bool) -> None:
    facts = with_(
        ALL_WELL,
        is_reset_requested=True,
        speed_mps=0.9 * STANDING_MPS if is_standing else STANDING_MPS,
    )
    is_granted = classify(with_(facts, last_mode=mode))[0] is Event.RESET
    assert is_granted == (mode is Mode.SAFE_STOP and is_standing)


def test_a_safe_stop_keeps_the_cause_that_it_began_with() -> None:
    lost = with_(HELD, planned=None, state=None)
    mode, cause = decide(with_(lost, last_mode=Mode.HOLD_PLAN), StopCause.STATE_LOST)
    assert (mode, cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)
    later = with_(ALL_WELL, is_vehicle_braking=True)
    assert decide(with_(later, last_mode=mode), cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)


def test_nominal_and_standby_have_no_cause() -> None:
    assert decide(with_(ALL_WELL, last_mode=Mode.HOLD_PLAN), StopCause.STATE_LOST) == (
        Mode.NOMINAL,
        StopCause.NONE,
    )
    no_mission = with_(ALL_WELL, has_mission=False)
    assert decide(with_(no_mission, last_mode=Mode.STANDBY), StopCause.NONE) == (
        Mode.STANDBY,
        StopCause.NONE,
    )


def test_an_alarm_of_a_check_stops_a_driving_car() -> None:
    facts = with_(ALL_WELL, alarm=StopCause.YAW_RATE_IMPLAUSIBLE)
    assert decide(with_(facts, last_mode=Mode.NOMINAL), StopCause.NONE) == (
        Mode.SAFE_STOP,
        StopCause.YAW_RATE_IMPLAUSIBLE,
    )


def test_a_rejected_state_holds_the_plan_with_its_cause() -> None:
    facts = with_(HELD, rejection=StopCause.LATERAL_ERROR_IMPLAUSIBLE)
    assert decide(with_(facts, last_mode=Mode.NOMINAL), StopCause.NONE) == (
        Mode.HOLD_PLAN,
        StopCause.LATERAL_ERROR_IMPLAUSIBLE,
    )


def test_a_refused_car_stays_in_standby_with_the_reason() -> None:
    facts = with_(HELD, rejection=StopCause.NOT_ENGAGED, planned=None)
    assert decide(with_(facts, last_mode=Mode.STANDBY), StopCause.NONE) == (
        Mode.STANDBY,
        StopCause.NOT_ENGAGED,
    )


@pytest.mark.parametrize(
    ("facts", "cause"),
    [
        (with_(HELD, state=None, has_conflict=True), StopCause.STATE_CONFLICT),
        (with_(HELD, state=None, is_answered=False), StopCause.COMMANDS_UNANSWERED),
    ],
)
def test_a_missing_state_names_what_is_wrong_with_it(facts: Tick, cause: StopCause) -> None:
    assert decide(with_(facts, last_mode=Mode.NOMINAL), StopCause.NONE) == (Mode.HOLD_PLAN, cause)


@pytest.mark.parametrize(("periods_held", "is_held"), [(1, True), (2, True), (3, False)])
def test_a_plan_is_held_for_two_periods(periods_held: int, is_held: bool) -> None:
    event, _ = classify(with_(HELD, periods_held=periods_held, last_mode=Mode.NOMINAL))
    assert event is (Event.HOLDING if is_held else Event.PLAN_LOST)


@pytest.mark.parametrize("is_answered", [False, True])
@pytest.mark.parametrize("mode", [*DRIVING, Mode.STANDBY])
def test_a_drive_begins_when_the_vehicle_accepts_commands(mode: Mode, is_answered: bool) -> None:
    event, _ = classify(with_(ALL_WELL, is_answered=is_answered, last_mode=mode))
    is_idle = mode is Mode.STANDBY and not is_answered
    assert event is (Event.IDLE if is_idle else Event.PLANNED)


def test_a_car_that_brakes_itself_is_not_taken_over() -> None:
    facts = with_(ALL_WELL, is_vehicle_braking=True)
    assert classify(with_(facts, last_mode=Mode.STANDBY)) == (Event.IDLE, StopCause.NONE)


def test_a_car_stands_below_0_3_m_per_s() -> None:
    assert STANDING_MPS == 0.3
