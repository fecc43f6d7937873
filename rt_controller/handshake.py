"""Before the loop: wait for the vehicle, check that it fits, and set the clock's phase by it."""

import can

from rt_controller.bus.identity import require_same_catalogue
from rt_controller.bus.messages import REFERENCE, STATE, VEHICLE_IDENTITY
from rt_controller.bus.receive import Inbox
from rt_controller.contract.errors import BusError
from rt_controller.loop import StopRequest
from rt_controller.realtime.clock import Clock, LockstepClock

LONGEST_LOCKSTEP_WAIT_NS = 5_000_000_000
"""in simulated time the vehicle sends from the first period on, if it ever does"""


def wait_for_vehicle(
    bus: can.BusABC,
    inbox: Inbox,
    clock: Clock,
    phase_ns: int,
    wait_ns: int,
    request: StopRequest,
) -> None:
    """Return when state, path and identity were received, or a stop is requested.

    The clock's ticks are then `phase_ns` after the vehicle's frames.

    Raises:
        BusError: nothing valid within `wait_ns`, the bus cannot be read, another controller is
            on it, or the vehicle uses another message catalogue.
    """
    began_ns = clock.now_ns()
    if isinstance(clock, LockstepClock):
        wait_ns = min(wait_ns, LONGEST_LOCKSTEP_WAIT_NS)
    while not request.is_requested:
        inbox.drain(bus, clock.now_ns())
        inbox.require_readable()
        if inbox.foreign_frames > 0:
            raise BusError(
                "Expected to be the only controller on this bus, found frames of "
                "another one. Stop it first, or choose another channel."
            )
        now_ns = clock.now_ns()
        peer, state = inbox.newest(VEHICLE_IDENTITY), inbox.newest_valid(STATE, now_ns)
        if peer is not None:
            require_same_catalogue(peer.content, inbox.is_fd)
            if state is not None and inbox.newest_valid(REFERENCE, now_ns) is not None:
                clock.align(state.arrival_ns + phase_ns)
                return
        if clock.now_ns() - began_ns > wait_ns:
            raise BusError(_missing_frames(inbox, wait_ns))
        clock.poll()


def _missing_frames(inbox: Inbox, wait_ns: int) -> str:
    received = {
        "IDENT_VEHICLE": inbox.newest(VEHICLE_IDENTITY),
        "a complete STATE_A/B/C": inbox.newest(STATE),
        "a complete REF_PATH/REF_SPEED": inbox.newest(REFERENCE),
    }
    missing = ", ".join(name for name, newest in received.items() if newest is None)
    if inbox.counts.other_format > 0:
        own, other = ("CAN FD", "classic CAN") if inbox.is_fd else ("classic CAN", "CAN FD")
        return (
            f"Expected the vehicle on the bus with frames of {own} within {wait_ns / 1e9:g} s, "
            f"found {inbox.counts.other_format} of {other}. Start both ends with --fd, or both "
            f"without."
        )
    dropped = inbox.counts.crc_errors + inbox.counts.out_of_range
    return (
        f"Expected the vehicle on the bus within {wait_ns / 1e9:g} s, still missing: {missing} "
        f"({dropped} frames were dropped as damaged or out of range). Start sim-bridge on the same "
        f"bus and channel, or check the wiring."
    )
