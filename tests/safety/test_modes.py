"""The mode table, mode x event; and the events, from the facts of a tick."""

import itertools

import pytest

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.safety.modes import (
    BUS_CAUSES,
    STANDING_MPS,
    TRANSITIONS,
    Event,
    TickFacts,
    classify,
    decide,
    next_mode,
)

ALL = list(itertools.product(Mode, Event))
DRIVING = [Mode.NOMINAL, Mode.LOW_SPEED, Mode.STANDSTILL, Mode.HOLD_PLAN]
LAWS = [
    (Event.PLANNED, Mode.NOMINAL),
    (Event.LOW_SPEED, Mode.LOW_SPEED),
    (Event.STANDSTILL, Mode.STANDSTILL),
]
ALL_WELL = TickFacts(
    bus_fault=StopCause.NONE,
    has_state=True,
    has_path=True,
    has_invalid_state=False,
    has_invalid_path=False,
    has_mission=True,
    is_engaged=True,
    is_reset_requested=False,
    is_stop_requested=False,
    is_vehicle_braking=False,
    is_standing=False,
    periods_held=0,
    law=Mode.NOMINAL,
    has_input=True,
)
HELD = ALL_WELL._replace(periods_held=1)


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
    assert classify(ALL_WELL._replace(law=law), mode) == (event, StopCause.NONE)
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
    assert classify(ALL_WELL._replace(bus_fault=cause), mode) == (Event.FAULT, cause)


@pytest.mark.parametrize(
    ("facts", "cause"),
    [
        (ALL_WELL._replace(is_stop_requested=True), StopCause.STOP_REQUESTED),
        (ALL_WELL._replace(is_vehicle_braking=True), StopCause.VEHICLE_BRAKING),
    ],
)
def test_a_stop_request_and_a_braking_vehicle_are_faults_except_in_standby(
    facts: TickFacts, cause: StopCause
) -> None:
    for mode in (*DRIVING, Mode.SAFE_STOP):
        assert classify(facts, mode) == (Event.FAULT, cause)
    assert classify(facts, Mode.STANDBY)[0] is not Event.FAULT


@pytest.mark.parametrize(
    ("facts", "event", "cause"),
    [
        (ALL_WELL, Event.PLANNED, StopCause.NONE),
        (ALL_WELL._replace(is_engaged=False), Event.IDLE, StopCause.NONE),
        (ALL_WELL._replace(has_mission=False), Event.PLAN_LOST, StopCause.MISSION_LOST),
        (HELD, Event.HOLDING, StopCause.SOLVER_FAILED),
        (HELD._replace(has_path=False), Event.HOLDING, StopCause.REFERENCE_LOST),
        (HELD._replace(has_state=False), Event.HOLDING, StopCause.STATE_LOST),
        (
            HELD._replace(has_state=False, state_loss=StopCause.BUS_OFF),
            Event.HOLDING,
            StopCause.BUS_OFF,
        ),
        (HELD._replace(state_loss=StopCause.BUS_OFF), Event.HOLDING, StopCause.SOLVER_FAILED),
        (
            HELD._replace(has_path=False, has_invalid_path=True),
            *(Event.HOLDING, StopCause.REFERENCE_INVALID),
        ),
        (
            HELD._replace(has_state=False, has_invalid_state=True),
            *(Event.HOLDING, StopCause.STATE_INVALID),
        ),
        (HELD._replace(has_input=False), Event.PLAN_LOST, StopCause.SOLVER_FAILED),
        (
            HELD._replace(periods_held=HOLD_PLAN_TICKS + 1),
            *(Event.PLAN_LOST, StopCause.SOLVER_FAILED),
        ),
    ],
)
@pytest.mark.parametrize("mode", DRIVING)
def test_the_event_of_a_driven_tick_names_the_missing_part(
    mode: Mode, facts: TickFacts, event: Event, cause: StopCause
) -> None:
    assert classify(facts, mode) == (event, cause)


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("is_standing", [False, True])
def test_a_reset_is_granted_in_safe_stop_when_the_car_stands(mode: Mode, is_standing: bool) -> None:
    facts = ALL_WELL._replace(is_reset_requested=True, is_standing=is_standing)
    is_granted = classify(facts, mode)[0] is Event.RESET
    assert is_granted == (mode is Mode.SAFE_STOP and is_standing)


def test_a_safe_stop_keeps_the_cause_that_it_began_with() -> None:
    lost = HELD._replace(has_input=False, has_state=False)
    mode, cause = decide(lost, Mode.HOLD_PLAN, StopCause.STATE_LOST)
    assert (mode, cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)
    later = ALL_WELL._replace(is_vehicle_braking=True)
    assert decide(later, mode, cause) == (Mode.SAFE_STOP, StopCause.STATE_LOST)


def test_nominal_and_standby_have_no_cause() -> None:
    assert decide(ALL_WELL, Mode.HOLD_PLAN, StopCause.STATE_LOST) == (Mode.NOMINAL, StopCause.NONE)
    no_mission = ALL_WELL._replace(has_mission=False)
    assert decide(no_mission, Mode.STANDBY, StopCause.NONE) == (Mode.STANDBY, StopCause.NONE)


def test_an_alarm_of_a_check_stops_a_driving_car() -> None:
    facts = ALL_WELL._replace(alarm=StopCause.YAW_RATE_IMPLAUSIBLE)
    assert decide(facts, Mode.NOMINAL, StopCause.NONE) == (
        Mode.SAFE_STOP,
        StopCause.YAW_RATE_IMPLAUSIBLE,
    )


def test_a_rejected_state_holds_the_plan_with_its_cause() -> None:
    facts = HELD._replace(rejection=StopCause.LATERAL_ERROR_IMPLAUSIBLE)
    assert decide(facts, Mode.NOMINAL, StopCause.NONE) == (
        Mode.HOLD_PLAN,
        StopCause.LATERAL_ERROR_IMPLAUSIBLE,
    )


def test_a_refused_car_stays_in_standby_with_the_reason() -> None:
    facts = HELD._replace(rejection=StopCause.NOT_ENGAGED, has_input=False)
    assert decide(facts, Mode.STANDBY, StopCause.NONE) == (Mode.STANDBY, StopCause.NOT_ENGAGED)


@pytest.mark.parametrize(
    ("facts", "cause"),
    [
        (HELD._replace(has_state=False, has_conflict=True), StopCause.STATE_CONFLICT),
        (HELD._replace(has_state=False, is_answered=False), StopCause.COMMANDS_UNANSWERED),
    ],
)
def test_a_missing_state_names_what_is_wrong_with_it(facts: TickFacts, cause: StopCause) -> None:
    assert decide(facts, Mode.NOMINAL, StopCause.NONE) == (Mode.HOLD_PLAN, cause)


@pytest.mark.parametrize(("periods_held", "is_held"), [(1, True), (2, True), (3, False)])
def test_a_plan_is_held_for_two_periods(periods_held: int, is_held: bool) -> None:
    event, _ = classify(HELD._replace(periods_held=periods_held), Mode.NOMINAL)
    assert event is (Event.HOLDING if is_held else Event.PLAN_LOST)


@pytest.mark.parametrize("is_answered", [False, True])
@pytest.mark.parametrize("mode", [*DRIVING, Mode.STANDBY])
def test_a_drive_begins_when_the_vehicle_accepts_commands(mode: Mode, is_answered: bool) -> None:
    event, _ = classify(ALL_WELL._replace(is_answered=is_answered), mode)
    is_idle = mode is Mode.STANDBY and not is_answered
    assert event is (Event.IDLE if is_idle else Event.PLANNED)


def test_a_car_that_brakes_itself_is_not_taken_over() -> None:
    facts = ALL_WELL._replace(is_vehicle_braking=True)
    assert classify(facts, Mode.STANDBY) == (Event.IDLE, StopCause.NONE)


def test_a_car_stands_below_0_3_m_per_s() -> None:
    assert STANDING_MPS == 0.3
