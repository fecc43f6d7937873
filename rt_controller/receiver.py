"""The receiving half of a control step: the newest data from the bus, where fresh and valid."""

from typing import Any, NamedTuple

import can

from rt_controller.bus.catalogue import (
    MISSION,
    PREVIEW,
    REFERENCE,
    SAMPLE_TIME_WRAP_NS,
    STATE,
    VEHICLE_IDENTITY,
    Mission,
    StateSample,
)
from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.inbox import Inbox, Received
from rt_controller.bus.message import Message
from rt_controller.contract.preview import is_plausible
from rt_controller.contract.signals import CurvaturePreview, PathReference
from rt_controller.contract.timing import COUNTER_MODULUS, counter_lag
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    ROUND_TRIP_MAX_TICKS,
    STATE_MAX_AGE_NS,
    TransportDelay,
    is_fresh,
)
from rt_controller.safety.modes import StopCause

READ_AHEAD_FRAMES = 64
"""most frames read at a time before a tick: a period brings twelve, and a flooded bus must not make
the tick late"""


class FreshData(NamedTuple):
    """What may be used in one tick; None: nothing fresh and valid."""

    state: StateSample | None
    path: PathReference | None
    preview: CurvaturePreview | None
    """None: the curvature of the road ahead is taken as constant"""
    mission: Mission | None
    is_new_mission: bool
    is_next_state: bool
    """no period lies between the last state and this one"""
    has_invalid_state: bool
    """frames of the state with values that may not be used were received"""
    has_invalid_path: bool
    """the same of the path"""
    has_implausible_preview: bool
    """a preview was dropped because it contradicts the state"""


class Receiver:
    """Reads the bus and keeps the counter of the tick's state."""

    def __init__(self, bus: can.BusABC, inbox: Inbox) -> None:
        self.counter = 0
        """of the newest state; counts on by one a period while no state arrives. A command carries
        it, so the vehicle can tell which state it answers."""
        self._bus = bus
        self._inbox = inbox
        self._own_dbc_hash = dbc_hash()
        self._delay = TransportDelay(SAMPLE_TIME_WRAP_NS)
        self._last_state: Received[StateSample] | None = None
        self._last_delay_ns = 0
        self._last_mission: Received[Mission] | None = None
        self._last_out_of_range = {STATE: 0, REFERENCE: 0}

    def read_ahead(self, now_ns: int) -> None:
        """Read the frames that have arrived before the tick."""
        self._inbox.drain(self._bus, now_ns, READ_AHEAD_FRAMES)

    def receive(self, now_ns: int, periods: int, is_standby: bool) -> FreshData:
        """Read all waiting frames; the data for this tick, `periods` after the last one."""
        inbox = self._inbox
        inbox.drain(self._bus, now_ns)
        self.counter += periods

        state, is_next = inbox.newest(STATE), False
        if state is self._last_state:
            state = None
        if state is not None:
            self._last_state = state
            is_next = periods == 1 and state.counter == self.counter % COUNTER_MODULUS
            self.counter = state.counter
            if is_standby:
                self._delay.reset()  # the car is not driven: the vehicle may have restarted
            self._last_delay_ns = self._delay.measure(
                state.arrival_ns, state.content.sample_time_ns
            )
            if not self._is_in_time(state, now_ns):
                state = None

        reference, preview = inbox.newest(REFERENCE), inbox.newest(PREVIEW)
        if reference is not None and not is_fresh(
            reference.arrival_ns, now_ns, REFERENCE_MAX_AGE_NS
        ):
            reference = None
        if preview is not None and not is_fresh(preview.arrival_ns, now_ns, REFERENCE_MAX_AGE_NS):
            preview = None
        is_implausible = (
            state is not None
            and preview is not None
            and preview.content is not None
            and not is_plausible(preview.content, state.content.curvature_per_m)
        )
        mission = inbox.newest(MISSION)
        if mission is not None and not is_fresh(
            mission.arrival_ns, now_ns, mission.content.valid_for_ns
        ):
            mission = None
        is_new_mission = mission is not self._last_mission
        self._last_mission = mission
        return FreshData(
            None if state is None else state.content,
            None if reference is None else reference.content,
            None if preview is None or is_implausible else preview.content,
            None if mission is None else mission.content,
            is_new_mission,
            is_next,
            self._is_invalid(STATE),
            self._is_invalid(REFERENCE),
            is_implausible,
        )

    def state_age_ns(self, now_ns: int) -> int | None:
        """Age of the newest state, its extra transport delay included; None before the first."""
        if self._last_state is None:
            return None
        return now_ns - self._last_state.arrival_ns + self._last_delay_ns

    def bus_fault(self) -> StopCause:
        """What is wrong with the bus or with the other participants on it; NONE if nothing is."""
        inbox = self._inbox
        peer = inbox.newest(VEHICLE_IDENTITY)
        if peer is not None and peer.content.dbc_hash != self._own_dbc_hash:
            return StopCause.PEER_MISMATCH
        if inbox.last_failure:
            return StopCause.BUS_FAILED
        if inbox.foreign_frames > 0:
            return StopCause.SECOND_CONTROLLER
        return StopCause.NONE

    def _is_invalid(self, message: Message[Any]) -> bool:
        """True if frames of this message that may not be used were received since the last call."""
        before = self._last_out_of_range[message]
        self._last_out_of_range[message] = self._inbox.out_of_range(message)
        return self._last_out_of_range[message] > before

    def _is_in_time(self, state: Received[StateSample], now_ns: int) -> bool:
        # Its age counts from its arrival, also if it was read before the tick.
        age_ns = now_ns - state.arrival_ns + self._last_delay_ns
        return age_ns <= STATE_MAX_AGE_NS and _round_trip_ticks(state) <= ROUND_TRIP_MAX_TICKS


def _round_trip_ticks(state: Received[StateSample]) -> int:
    """Periods from a command to the state that shows its effect; normally 1."""
    echo = state.content.command_echo
    return 0 if echo is None else counter_lag(newer=state.counter, older=echo)
