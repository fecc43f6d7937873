"""The mode machine: the facts of a tick give an event, and one table gives the next mode."""

from enum import Enum
from typing import NamedTuple

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS


class Event(Enum):
    """The result of one tick, as far as the mode depends on it."""

    IDLE = "no mission is engaged"
    PLANNED = "a fresh state was received and a plan was found"
    LOW_SPEED = "a fresh state was received, and the car is too slow for the model"
    STANDSTILL = "a fresh state was received, and the car is held at a standstill"
    HOLDING = "no plan in this tick, but the last good plan may still be followed"
    PLAN_LOST = "no plan in this tick, and no last good plan that may be followed"
    FAULT = "a fault that does not clear by itself"
    RESET = "an explicit request to leave SAFE_STOP"


_FOLLOWING = {
    Event.IDLE: Mode.STANDBY,
    Event.PLANNED: Mode.NOMINAL,
    Event.LOW_SPEED: Mode.LOW_SPEED,
    Event.STANDSTILL: Mode.STANDSTILL,
    Event.HOLDING: Mode.HOLD_PLAN,
    Event.PLAN_LOST: Mode.SAFE_STOP,
    Event.FAULT: Mode.SAFE_STOP,
}
"""of a car that is driven; a request to leave SAFE_STOP changes nothing there"""


def _after(mode: Mode, event: Event) -> Mode:
    if mode is Mode.SAFE_STOP:  # never left without an explicit request
        return Mode.STANDBY if event is Event.RESET else Mode.SAFE_STOP
    is_without_plan = event in (Event.HOLDING, Event.PLAN_LOST)
    if mode is Mode.STANDBY and is_without_plan:  # not engaged yet: there is no plan to hold
        return Mode.STANDBY
    return _FOLLOWING.get(event, mode)


TRANSITIONS: dict[Mode, dict[Event, Mode]] = {
    mode: {event: _after(mode, event) for event in Event} for mode in Mode
}
"""the whole table, for the loop and for people"""


def next_mode(mode: Mode, event: Event) -> Mode:
    """The mode after `event`; no other code changes the mode."""
    return TRANSITIONS[mode][event]


STANDING_MPS = 0.3
"""below this speed the car counts as standing: a request to leave SAFE_STOP may be granted"""
BUS_CAUSES = (StopCause.BUS_FAILED, StopCause.PEER_MISMATCH, StopCause.SECOND_CONTROLLER)
"""faults of the bus: they do not clear by waiting"""
RECOVERABLE_BUS_CAUSES = (StopCause.BUS_OFF, StopCause.INTERFACE_DOWN)
"""faults of the bus that may clear by themselves: its driver restarts it, or the link comes up"""
_EVENT_OF_LAW = {
    Mode.NOMINAL: Event.PLANNED,
    Mode.LOW_SPEED: Event.LOW_SPEED,
    Mode.STANDSTILL: Event.STANDSTILL,
}
_MODES_WITH_CAUSE = (Mode.HOLD_PLAN, Mode.SAFE_STOP)


class TickFacts(NamedTuple):
    """What one tick received and planned, as far as the mode depends on it."""

    bus_fault: StopCause
    """one of `BUS_CAUSES`, or NONE"""
    has_state: bool
    has_path: bool
    has_invalid_state: bool
    """frames of the state with values that may not be used were received"""
    has_invalid_path: bool
    """the same of the path"""
    has_mission: bool
    is_engaged: bool
    is_reset_requested: bool
    """by a mission message that is new in this tick"""
    is_stop_requested: bool
    is_vehicle_braking: bool
    is_standing: bool
    periods_held: int
    """periods since the plan was made; 0: in this tick"""
    law: Mode
    """what made the plan: NOMINAL the model, LOW_SPEED or STANDSTILL the low-speed law"""
    has_input: bool
    """the last good plan has an input for this tick"""
    is_answered: bool = True
    """the vehicle accepts the commands"""
    has_conflict: bool = False
    """states contradict each other"""
    alarm: StopCause = StopCause.NONE
    """of a plausibility check that stops the car"""
    rejection: StopCause = StopCause.NONE
    """why a check refuses the state or the path of this tick, or the car in STANDBY"""
    state_loss: StopCause = StopCause.STATE_LOST
    """STATE_LOST or one of `RECOVERABLE_BUS_CAUSES`: the cause if no state arrives"""


def decide(facts: TickFacts, mode: Mode, cause: StopCause) -> tuple[Mode, StopCause]:
    """The next mode and its cause, after `mode` and its `cause`.

    A safe stop keeps the cause that it began with. STANDBY has one only while a car is refused.
    """
    event, new_cause = classify(facts, mode)
    following = next_mode(mode, event)
    if following is Mode.SAFE_STOP and mode is Mode.SAFE_STOP:
        return following, cause
    if new_cause is StopCause.NOT_ENGAGED:
        return following, new_cause
    return following, new_cause if following in _MODES_WITH_CAUSE else StopCause.NONE


def classify(facts: TickFacts, mode: Mode) -> tuple[Event, StopCause]:
    """The event of a tick that began in `mode`, and its cause; NONE where nothing is wrong."""
    fault = _fault(facts, mode)
    if fault is not StopCause.NONE:
        return Event.FAULT, fault
    if not facts.has_mission:
        return Event.PLAN_LOST, StopCause.MISSION_LOST
    if facts.is_reset_requested and mode is Mode.SAFE_STOP and facts.is_standing:
        return Event.RESET, StopCause.NONE
    is_ready = facts.is_answered or mode is not Mode.STANDBY
    if not facts.is_engaged or facts.is_vehicle_braking or not is_ready:
        return Event.IDLE, StopCause.NONE  # a drive begins after the vehicle accepts commands
    if facts.periods_held == 0:
        return _EVENT_OF_LAW[facts.law], StopCause.NONE
    may_hold = facts.has_input and facts.periods_held <= HOLD_PLAN_TICKS
    return Event.HOLDING if may_hold else Event.PLAN_LOST, _missing_part(facts)


def _fault(facts: TickFacts, mode: Mode) -> StopCause:
    if facts.bus_fault is not StopCause.NONE or mode is Mode.STANDBY:
        return facts.bus_fault  # in STANDBY the controller does not drive: no other fault counts
    if facts.is_stop_requested:
        return StopCause.STOP_REQUESTED
    return StopCause.VEHICLE_BRAKING if facts.is_vehicle_braking else facts.alarm


def _missing_part(facts: TickFacts) -> StopCause:
    if facts.rejection is not StopCause.NONE:
        return facts.rejection
    if not facts.has_state:
        if facts.has_conflict:
            return StopCause.STATE_CONFLICT
        if not facts.is_answered:
            return StopCause.COMMANDS_UNANSWERED
        return StopCause.STATE_INVALID if facts.has_invalid_state else facts.state_loss
    if facts.has_path:
        return StopCause.SOLVER_FAILED
    return StopCause.REFERENCE_INVALID if facts.has_invalid_path else StopCause.REFERENCE_LOST
