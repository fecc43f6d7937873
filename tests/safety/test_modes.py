"""The mode table, swept: every mode x every event."""

import itertools

import pytest

from rt_controller.contract.signals import Mode
from rt_controller.safety.modes import TRANSITIONS, Event, next_mode

EVERYTHING = list(itertools.product(Mode, Event))


@pytest.mark.parametrize(("mode", "event"), EVERYTHING)
def test_every_mode_answers_every_event(mode: Mode, event: Event) -> None:
    assert next_mode(mode, event) in Mode


@pytest.mark.parametrize("mode", Mode)
def test_a_fault_stops_the_car_from_everywhere(mode: Mode) -> None:
    assert next_mode(mode, Event.FAULT) is Mode.SAFE_STOP


@pytest.mark.parametrize("event", [e for e in Event if e is not Event.RESET])
def test_only_an_explicit_request_leaves_a_safe_stop(event: Event) -> None:
    assert next_mode(Mode.SAFE_STOP, event) is Mode.SAFE_STOP
    assert next_mode(Mode.SAFE_STOP, Event.RESET) is Mode.STANDBY


@pytest.mark.parametrize(
    ("mode", "event"), [(m, e) for m, e in EVERYTHING if e is not Event.PLANNED]
)
def test_nothing_but_a_plan_leads_to_nominal(mode: Mode, event: Event) -> None:
    if mode is not Mode.NOMINAL:
        assert next_mode(mode, event) is not Mode.NOMINAL


@pytest.mark.parametrize("mode", [Mode.NOMINAL, Mode.HOLD_PLAN])
def test_a_driving_car_holds_its_plan_and_then_stops(mode: Mode) -> None:
    assert next_mode(mode, Event.UNPLANNED) is Mode.HOLD_PLAN
    assert next_mode(mode, Event.LOST) is Mode.SAFE_STOP


@pytest.mark.parametrize("event", [Event.IDLE, Event.UNPLANNED, Event.LOST, Event.RESET])
def test_a_standing_by_controller_stays_so_without_a_plan(event: Event) -> None:
    assert next_mode(Mode.STANDBY, event) is Mode.STANDBY


def test_the_table_has_no_other_entries() -> None:
    assert set(TRANSITIONS) == set(Mode)
    assert all(set(row) == set(Event) for row in TRANSITIONS.values())
