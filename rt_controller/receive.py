"""The receiving half of a control step: the newest data from the bus, where fresh and valid."""

from typing import Any, TypeVar

import can

from rt_controller.bus.condition import BusState
from rt_controller.bus.identity import Engagement, PeerCatalogue
from rt_controller.bus.messages import (
    FEEDBACK,
    MISSION,
    PREVIEW,
    REFERENCE,
    SAMPLE_TIME_WRAP_NS,
    STATE,
    VEHICLE_IDENTITY,
    Message,
    Mission,
    StateSample,
)
from rt_controller.bus.receive import Inbox, Received
from rt_controller.contract.faults import StopCause
from rt_controller.contract.preview import is_plausible
from rt_controller.contract.signals import ControlInput, CurvaturePreview, PathReference
from rt_controller.contract.timing import LONG_COUNTER_MODULUS, counter_lag
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    REFERENCE_MAX_TICKS,
    ROUND_TRIP_MAX_TICKS,
    STATE_MAX_AGE_NS,
    SampleGrid,
    TransportDelay,
    is_fresh,
)
from rt_controller.safety.tick import Tick

_STATE_LOSS = {BusState.BUS_OFF: StopCause.BUS_OFF, BusState.DOWN: StopCause.INTERFACE_DOWN}
T = TypeVar("T")

READ_AHEAD_FRAMES = 64
"""most frames read at a time before a tick: a period brings twelve, and a flooded bus must not make
the tick late"""


class Receiver:
    """Reads the bus and keeps the counter of the tick's state."""

    def __init__(self, bus: can.BusABC, inbox: Inbox) -> None:
        self.counter = 0
        """long counter of the newest state; counts on by one a period while no state arrives. A
        command carries it, so the vehicle can determine which state it answers."""
        self.transport_periods = 0
        """from a command to the state that shows its effect, beyond the period in which it acts"""
        self.command_echo: int | None = None
        """counter of the last command that the vehicle has accepted, by the state of this tick"""
        self._bus = bus
        self._inbox = inbox
        self._delay = TransportDelay(SAMPLE_TIME_WRAP_NS)
        self._grid = SampleGrid(SAMPLE_TIME_WRAP_NS)
        self._state: Received[StateSample] | None = None
        self._delay_ns = 0
        """of this state, beyond the fastest transport"""
        self._path: Received[PathReference] | None = None
        self._preview: Received[CurvaturePreview | None] | None = None
        self._mission: Received[Mission] | None = None
        self._feedback: Received[ControlInput] | None = None
        self._engagement = Engagement()
        self._catalogue = PeerCatalogue()
        self._out_of_range = {STATE: 0, REFERENCE: 0}

    def read_ahead(self, now_ns: int) -> None:
        """Read the frames that have arrived before the tick."""
        self._inbox.drain(self._bus, now_ns, READ_AHEAD_FRAMES)

    def receive(self, tick: Tick, now_ns: int) -> None:
        """Read all waiting frames, and fill in what of them may be used in this tick."""
        inbox = self._inbox
        inbox.drain(self._bus, now_ns)
        self.counter += tick.periods
        self._receive_state(tick, now_ns)
        self._receive_path(tick, now_ns)
        self._receive_mission(tick, now_ns)
        feedback = inbox.newest_valid(FEEDBACK, now_ns)
        if feedback is not None and feedback is not self._feedback:
            tick.feedback = feedback.content
        self._feedback = feedback
        tick.has_conflict = inbox.has_conflict(STATE, now_ns)
        tick.has_invalid_state = self._is_invalid(STATE)
        tick.has_invalid_path = self._is_invalid(REFERENCE)
        inbox.end_period(now_ns)
        tick.bus_fault = self._bus_fault()
        tick.state_loss = _STATE_LOSS.get(inbox.condition.state, StopCause.STATE_LOST)

    def _receive_state(self, tick: Tick, now_ns: int) -> None:
        """The state, if it is new, in time, and answers a command that is recent enough."""
        state, is_standby = self._inbox.newest_valid(STATE, now_ns), not tick.is_driven
        self.command_echo = None
        if state is None or state is self._state:
            return
        self._state, sample = state, state.content
        is_next = tick.periods == 1 and (state.counter - self.counter) % LONG_COUNTER_MODULUS == 0
        self.counter = state.counter
        echo = sample.command_echo
        if echo is not None:
            self.transport_periods = max(counter_lag(state.counter, echo) - 1, 0)
        if is_standby:
            self._delay.reset()  # the car is not driven: the vehicle may have restarted
        self._delay_ns = self._delay.measure(state.arrival_ns, sample.sample_time_ns)
        tick.sample_time = self._grid.measure(sample.sample_time_ns, state.counter)
        tick.is_next_state = is_next
        # Its age counts from its arrival, also if it was read before the tick.
        if now_ns - state.arrival_ns + self._delay_ns > STATE_MAX_AGE_NS:
            return
        tick.is_answered = _is_answered(state)
        if not (tick.is_answered or is_standby):
            return
        self.command_echo = echo
        tick.state, tick.curvature_per_m = sample.state, sample.curvature_per_m
        tick.is_vehicle_braking = sample.is_watchdog_braking

    def _receive_path(self, tick: Tick, now_ns: int) -> None:
        """Path and curvature ahead, while they are fresh."""
        self._path = self._recent(REFERENCE, self._path, now_ns)
        self._preview = self._recent(PREVIEW, self._preview, now_ns)
        if self._path is not None:
            tick.path = self._path.content
        if self._preview is not None:
            preview = tick.preview = self._preview.content
            if preview is not None and tick.state is not None:
                tick.has_implausible_preview = not is_plausible(preview, tick.curvature_per_m)

    def _receive_mission(self, tick: Tick, now_ns: int) -> None:
        """The request of the vehicle, for as long as it is valid."""
        mission = self._inbox.newest_valid(MISSION, now_ns) or self._mission
        if mission is not None:
            valid_ns = mission.content.valid_for_ns
            mission = mission if is_fresh(mission.arrival_ns, now_ns, valid_ns) else None
        if mission is not None:
            tick.has_mission, content = True, mission.content
            tick.is_engaged = self._engagement.confirmed(mission)
            tick.is_ending = not content.is_engaged
            tick.is_reset_requested = content.is_reset_requested and mission is not self._mission
        self._mission = mission

    def state_age_ns(self, now_ns: int) -> int | None:
        """Age of the newest state, its extra transport delay included; None before the first."""
        if self._state is None:
            return None
        return now_ns - self._state.arrival_ns + self._delay_ns

    def _bus_fault(self) -> StopCause:
        """What is wrong with the bus or with the other participants on it; NONE if nothing is."""
        inbox = self._inbox
        if self._catalogue.is_another(inbox.newest(VEHICLE_IDENTITY)):
            return StopCause.PEER_MISMATCH
        if inbox.last_failure:
            return StopCause.BUS_FAILED
        return StopCause.SECOND_CONTROLLER if inbox.foreign_frames > 0 else StopCause.NONE

    def _is_invalid(self, message: Message[Any]) -> bool:
        """True if frames of this message that may not be used were received since the last call."""
        before = self._out_of_range[message]
        self._out_of_range[message] = self._inbox.out_of_range(message)
        return self._out_of_range[message] > before

    def _recent(
        self, message: Message[T], last: Received[T] | None, now_ns: int
    ) -> Received[T] | None:
        """The newest path or preview that is valid and fresh; else the last one, while fresh.

        Both its arrival and its counter, which is that of a state, have to be fresh. A counter
        ahead of the newest state is not of this vehicle.
        """
        for each in (self._inbox.newest_valid(message, now_ns), last):
            if each is not None:
                lag = (self.counter - each.counter) % LONG_COUNTER_MODULUS
                is_recent = is_fresh(each.arrival_ns, now_ns, REFERENCE_MAX_AGE_NS)
                if is_recent and lag <= REFERENCE_MAX_TICKS:
                    return each
        return None


def _is_answered(state: Received[StateSample]) -> bool:
    """True if the vehicle echoes a command that is at most four periods old; normally it is one.

    A vehicle that brakes by itself echoes the last command that it followed.
    """
    sample = state.content
    if sample.is_watchdog_braking:
        return True
    if sample.command_echo is None:
        return False
    return counter_lag(newer=state.counter, older=sample.command_echo) <= ROUND_TRIP_MAX_TICKS
