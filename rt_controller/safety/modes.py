"""The mode machine: the facts of a tick give an event, and one table gives the next mode."""

from enum import Enum, StrEnum
from typing import NamedTuple

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


TRANSITIONS: dict[Mode, dict[Event, Mode]] = {
    Mode.STANDBY: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.LOW_SPEED: Mode.LOW_SPEED,
        Event.STANDSTILL: Mode.STANDSTILL,
        Event.HOLDING: Mode.STANDBY,  # not engaged yet: there is no plan to hold
        Event.PLAN_LOST: Mode.STANDBY,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.STANDBY,
    },
    Mode.NOMINAL: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.LOW_SPEED: Mode.LOW_SPEED,
        Event.STANDSTILL: Mode.STANDSTILL,
        Event.HOLDING: Mode.HOLD_PLAN,
        Event.PLAN_LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.NOMINAL,
    },
    Mode.LOW_SPEED: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.LOW_SPEED: Mode.LOW_SPEED,
        Event.STANDSTILL: Mode.STANDSTILL,
        Event.HOLDING: Mode.HOLD_PLAN,
        Event.PLAN_LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.LOW_SPEED,
    },
    Mode.STANDSTILL: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.LOW_SPEED: Mode.LOW_SPEED,
        Event.STANDSTILL: Mode.STANDSTILL,
        Event.HOLDING: Mode.HOLD_PLAN,
        Event.PLAN_LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.STANDSTILL,
    },
    Mode.HOLD_PLAN: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.LOW_SPEED: Mode.LOW_SPEED,
        Event.STANDSTILL: Mode.STANDSTILL,
        Event.HOLDING: Mode.HOLD_PLAN,
        Event.PLAN_LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.HOLD_PLAN,
    },
    Mode.SAFE_STOP: {
        Event.IDLE: Mode.SAFE_STOP,
        Event.PLANNED: Mode.SAFE_STOP,
        Event.LOW_SPEED: Mode.SAFE_STOP,
        Event.STANDSTILL: Mode.SAFE_STOP,
        Event.HOLDING: Mode.SAFE_STOP,
        Event.PLAN_LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.STANDBY,
    },
}


def next_mode(mode: Mode, event: Event) -> Mode:
    """The mode after `event`; no other code changes the mode."""
    return TRANSITIONS[mode][event]


class StopCause(StrEnum):
    """Why the plan is held, or the car is stopped."""

    NONE = "none"
    STATE_LOST = "no new vehicle state arrived in time"
    STATE_INVALID = "the vehicle state arrives with values that may not be used"
    REFERENCE_LOST = "no fresh path reference"
    REFERENCE_INVALID = "the path reference arrives with values that may not be used"
    MISSION_LOST = "the mission is no longer valid"
    SOLVER_FAILED = "the QP was not solved"
    BUS_FAILED = "the bus cannot be read"
    SECOND_CONTROLLER = "another controller sends commands on this bus"
    PEER_MISMATCH = "the vehicle uses another message catalogue"
    VEHICLE_BRAKING = "the vehicle's own watchdog is braking"
    STOP_REQUESTED = "stop requested"


STANDING_MPS = 0.3
"""below this speed the car counts as standing: a request to leave SAFE_STOP may be granted"""
BUS_CAUSES = (StopCause.BUS_FAILED, StopCause.PEER_MISMATCH, StopCause.SECOND_CONTROLLER)
"""faults of the bus: they do not clear by waiting"""
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


def decide(facts: TickFacts, mode: Mode, cause: StopCause) -> tuple[Mode, StopCause]:
    """The next mode and its cause, after `mode` and its `cause`.

    A safe stop keeps the cause that it began with; only HOLD_PLAN and SAFE_STOP have one.
    """
    event, new_cause = classify(facts, mode)
    following = next_mode(mode, event)
    if following is Mode.SAFE_STOP and mode is Mode.SAFE_STOP:
        return following, cause
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
    if not facts.is_engaged or facts.is_vehicle_braking:
        return Event.IDLE, StopCause.NONE
    if facts.periods_held == 0:
        return _EVENT_OF_LAW[facts.law], StopCause.NONE
    may_hold = facts.has_input and facts.periods_held <= HOLD_PLAN_TICKS
    return Event.HOLDING if may_hold else Event.PLAN_LOST, _missing_part(facts)


def _fault(facts: TickFacts, mode: Mode) -> StopCause:
    if facts.bus_fault is not StopCause.NONE or mode is Mode.STANDBY:
        return facts.bus_fault  # in STANDBY the controller does not drive: no other fault counts
    if facts.is_stop_requested:
        return StopCause.STOP_REQUESTED
    return StopCause.VEHICLE_BRAKING if facts.is_vehicle_braking else StopCause.NONE


def _missing_part(facts: TickFacts) -> StopCause:
    if not facts.has_state:
        return StopCause.STATE_INVALID if facts.has_invalid_state else StopCause.STATE_LOST
    if facts.has_path:
        return StopCause.SOLVER_FAILED
    return StopCause.REFERENCE_INVALID if facts.has_invalid_path else StopCause.REFERENCE_LOST
