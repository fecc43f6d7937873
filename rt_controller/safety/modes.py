"""The mode machine: a tick gives an event, and one table gives the next mode."""

from enum import Enum

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.safety.tick import Tick


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


def decide(tick: Tick, cause: StopCause) -> tuple[Mode, StopCause]:
    """The mode of a tick that is planned, and its cause; `cause` is that of the tick before.

    A safe stop keeps the cause that it began with. STANDBY has one only while a car is refused.
    """
    event, new_cause = classify(tick)
    following = next_mode(tick.last_mode, event)
    if following is Mode.SAFE_STOP and tick.last_mode is Mode.SAFE_STOP:
        return following, cause
    if new_cause is StopCause.NOT_ENGAGED:
        return following, new_cause
    return following, new_cause if following in _MODES_WITH_CAUSE else StopCause.NONE


def classify(tick: Tick) -> tuple[Event, StopCause]:
    """The event of a tick that is planned, and its cause; NONE where nothing is wrong."""
    fault, mode = _fault(tick), tick.last_mode
    if fault is not StopCause.NONE:
        return Event.FAULT, fault
    if not tick.has_mission:
        return Event.PLAN_LOST, StopCause.MISSION_LOST
    if tick.is_reset_requested and mode is Mode.SAFE_STOP and _is_standing(tick):
        return Event.RESET, StopCause.NONE
    is_ready = (tick.is_answered and tick.is_wheel_matched) or mode is not Mode.STANDBY
    if not tick.is_engaged or tick.is_vehicle_braking or not is_ready:
        # A drive begins after the vehicle accepts commands, and without a turn of the wheel.
        return Event.IDLE, StopCause.NONE
    if tick.periods_held == 0:
        return _EVENT_OF_LAW[tick.law], StopCause.NONE
    may_hold = tick.planned is not None and tick.periods_held <= HOLD_PLAN_TICKS
    return Event.HOLDING if may_hold else Event.PLAN_LOST, _missing_part(tick)


def _is_standing(tick: Tick) -> bool:
    speed_mps = tick.estimate.speed_mps
    return speed_mps is not None and abs(speed_mps) < STANDING_MPS


def _fault(tick: Tick) -> StopCause:
    if tick.bus_fault is not StopCause.NONE or tick.last_mode is Mode.STANDBY:
        return tick.bus_fault  # in STANDBY the controller does not drive: no other fault counts
    if tick.is_stop_requested:
        return StopCause.STOP_REQUESTED
    return StopCause.VEHICLE_BRAKING if tick.is_vehicle_braking else tick.estimate.alarm


def _missing_part(tick: Tick) -> StopCause:
    if tick.estimate.rejection is not StopCause.NONE:
        return tick.estimate.rejection
    if tick.state is None:
        if tick.has_conflict:
            return StopCause.STATE_CONFLICT
        if not tick.is_answered:
            return StopCause.COMMANDS_UNANSWERED
        return StopCause.STATE_INVALID if tick.has_invalid_state else tick.state_loss
    if tick.path is not None:
        return StopCause.SOLVER_FAILED
    return StopCause.REFERENCE_INVALID if tick.has_invalid_path else StopCause.REFERENCE_LOST
