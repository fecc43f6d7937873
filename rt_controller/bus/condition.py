"""Condition of a bus as kernel and CAN controller report it: error frames, and the link's state.

An error frame of SocketCAN has its classes in the identifier and details in its data
(linux/can/error.h). Interfaces that report no error frames stay ACTIVE.
"""

import errno
from dataclasses import dataclass
from enum import Enum

import can

_CONTROLLER, _BUS_OFF, _RESTARTED = 0x004, 0x040, 0x100
"""classes"""
_RX_OVERFLOW, _TX_OVERFLOW, _WARNING, _PASSIVE, _ACTIVE = 0x01, 0x02, 0x0C, 0x30, 0x40
"""details of the class `_CONTROLLER`, in byte 1"""


class BusState(Enum):
    """What the CAN controller may do; the value is for people."""

    ACTIVE = "error-active"
    WARNING = "at the error warning level"
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"
    DOWN = "down: the interface was switched off"

    @property
    def is_silent(self) -> bool:
        """True if nothing can be sent or received."""
        return self in (BusState.BUS_OFF, BusState.DOWN)

    @property
    def is_disturbed(self) -> bool:
        """True if the bus is silent, or close to it because the node is error-passive."""
        return self is BusState.PASSIVE or self.is_silent


@dataclass(slots=True)
class BusCondition:
    """The present state, and how often something happened since the start."""

    state: BusState = BusState.ACTIVE
    error_frames: int = 0
    bus_off: int = 0
    restarts: int = 0
    """after bus-off, by the driver or by a person"""
    controller_overflows: int = 0
    """reported by the CAN controller: frames were lost in its own buffer"""
    link_downs: int = 0
    """the interface was switched off"""

    def note_error_frame(self, frame: can.Message) -> None:
        """Take over what an error frame reports; unknown classes are only counted."""
        self.error_frames += 1
        classes = frame.arbitration_id
        detail = frame.data[1] if classes & _CONTROLLER and len(frame.data) > 1 else 0
        if detail & (_RX_OVERFLOW | _TX_OVERFLOW):
            self.controller_overflows += 1
        if classes & _RESTARTED:
            self.restarts += 1
            self.state = BusState.ACTIVE
        if detail & _PASSIVE:
            self.state = BusState.PASSIVE
        elif detail & _WARNING:
            self.state = BusState.WARNING
        elif detail & _ACTIVE:
            self.state = BusState.ACTIVE
        if classes & _BUS_OFF:
            self.bus_off += 1
            self.state = BusState.BUS_OFF

    def note_frame(self) -> None:
        """A frame arrived: the bus is not silent (any more)."""
        if self.state.is_silent:
            self.state = BusState.ACTIVE

    def note_failure(self, error: Exception) -> bool:
        """True if `error` only says that the interface is down, which it may be for a while."""
        if getattr(error, "error_code", None) != errno.ENETDOWN:
            return False
        self.link_downs += 1
        self.state = BusState.DOWN
        return True


def is_queue_full(error: Exception) -> bool:
    """True if a frame was not taken because the queue of frames to be sent is full."""
    # If its socket takes nothing at all, python-can raises this text without a number.
    return (
        getattr(error, "error_code", None) == errno.ENOBUFS or "buffer full" in str(error).lower()
    )
