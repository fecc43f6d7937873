"""The mode machine: one table, state x event, nothing else decides."""

from enum import Enum

from rt_controller.contract.signals import Mode


class Event(Enum):
    """What one tick amounts to."""

    IDLE = "no mission is engaged"
    PLANNED = "a fresh state was seen and a plan was found"
    UNPLANNED = "no plan this tick, but the last good one may still stand in"
    LOST = "no plan, and none left to hold"
    FAULT = "something that no waiting will mend"
    RESET = "an explicit request to leave SAFE_STOP"


TRANSITIONS: dict[Mode, dict[Event, Mode]] = {
    Mode.STANDBY: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.UNPLANNED: Mode.STANDBY,  # never engaged: there is nothing to hold
        Event.LOST: Mode.STANDBY,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.STANDBY,
    },
    Mode.NOMINAL: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.UNPLANNED: Mode.HOLD_PLAN,
        Event.LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.NOMINAL,
    },
    Mode.HOLD_PLAN: {
        Event.IDLE: Mode.STANDBY,
        Event.PLANNED: Mode.NOMINAL,
        Event.UNPLANNED: Mode.HOLD_PLAN,
        Event.LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.HOLD_PLAN,
    },
    Mode.SAFE_STOP: {
        Event.IDLE: Mode.SAFE_STOP,
        Event.PLANNED: Mode.SAFE_STOP,
        Event.UNPLANNED: Mode.SAFE_STOP,
        Event.LOST: Mode.SAFE_STOP,
        Event.FAULT: Mode.SAFE_STOP,
        Event.RESET: Mode.STANDBY,
    },
}


def next_mode(mode: Mode, event: Event) -> Mode:
    """The mode after `event`."""
    return TRANSITIONS[mode][event]
