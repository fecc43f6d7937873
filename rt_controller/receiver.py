"""The receiving half of a control step: the newest data from the bus, where fresh and valid."""

from typing import Any, NamedTuple, TypeVar

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
    TransportDelay,
    is_fresh,
)

_STATE_LOSS = {BusState.BUS_OFF: StopCause.BUS_OFF, BusState.DOWN: StopCause.INTERFACE_DOWN}
T = TypeVar("T")

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
    is_answered: bool
    """the vehicle accepts the commands: the state echoes one that is recent enough"""
    has_conflict: bool
    """frames of the state contradict each other: of two vehicles, or old ones among new ones"""
    has_invalid_state: bool
    """frames of the state with values that may not be used were received"""
    has_invalid_path: bool
    """the same of the path"""
    has_implausible_preview: bool
    """a preview was dropped because it contradicts the state"""
    received_preview: CurvaturePreview | None
    """the preview, also if it contradicts the state"""
    feedback: ControlInput | None
    """of the actuators, new in this tick"""
    is_ending: bool
    """the newest mission no longer engages, and is not confirmed yet: a driver may have the car"""


class Receiver:
    """Reads the bus and keeps the counter of the tick's state."""

    def __init__(self, bus: can.BusABC, inbox: Inbox) -> None:
        self.counter = 0
        """long counter of the newest state; counts on by one a period while no state arrives. A
        command carries it, so the vehicle can determine which state it answers."""
        self.transport_periods = 0
        """from a command to the state that shows its effect, beyond the period in which it acts"""
        self._bus = bus
        self._inbox = inbox
        self._delay = TransportDelay(SAMPLE_TIME_WRAP_NS)
        self._last_state: Received[StateSample] | None = None
        self._last_delay_ns = 0
        self._last_reference: Received[PathReference] | None = None
        self._last_preview: Received[CurvaturePreview | None] | None = None
        self._last_mission: Received[Mission] | None = None
        self._last_feedback: Received[ControlInput] | None = None
        self._engagement = Engagement()
        self._catalogue = PeerCatalogue(inbox.is_fd)
        self._last_out_of_range = {STATE: 0, REFERENCE: 0}

    def read_ahead(self, now_ns: int) -> None:
        """Read the frames that have arrived before the tick."""
        self._inbox.drain(self._bus, now_ns, READ_AHEAD_FRAMES)

    def receive(self, now_ns: int, periods: int, is_standby: bool) -> FreshData:
        """Read all waiting frames; the data for this tick, `periods` after the last one."""
        inbox = self._inbox
        inbox.drain(self._bus, now_ns)
        self.counter += periods

        state, is_next = inbox.newest_valid(STATE, now_ns), False
        if state is self._last_state:
            state = None
        if state is not None:
            self._last_state = state
            is_next = periods == 1 and (state.counter - self.counter) % LONG_COUNTER_MODULUS == 0
            self.counter = state.counter
            echo = state.content.command_echo
            if echo is not None:
                self.transport_periods = max(counter_lag(state.counter, echo) - 1, 0)
            if is_standby:
                self._delay.reset()  # the car is not driven: the vehicle may have restarted
            self._last_delay_ns = self._delay.measure(
                state.arrival_ns, state.content.sample_time_ns
            )
            if not self._is_in_time(state, now_ns):
                state = None
        is_answered = state is None or _is_answered(state)
        if state is not None and not (is_answered or is_standby):
            state = None

        reference = self._recent(REFERENCE, self._last_reference, now_ns)
        preview = self._recent(PREVIEW, self._last_preview, now_ns)
        self._last_reference, self._last_preview = reference, preview
        is_implausible = (
            state is not None
            and preview is not None
            and preview.content is not None
            and not is_plausible(preview.content, state.content.curvature_per_m)
        )
        mission = inbox.newest_valid(MISSION, now_ns) or self._last_mission
        if mission is not None and not is_fresh(
            mission.arrival_ns, now_ns, mission.content.valid_for_ns
        ):
            mission = None
        is_new_mission = mission is not self._last_mission
        self._last_mission = mission
        request = None if mission is None else self._engagement.confirmed(mission)
        has_conflict = inbox.has_conflict(STATE, now_ns)
        feedback = self._new_feedback(now_ns)
        inbox.end_period(now_ns)
        return FreshData(
            None if state is None else state.content,
            None if reference is None else reference.content,
            None if preview is None or is_implausible else preview.content,
            request,
            is_new_mission,
            is_next,
            is_answered,
            has_conflict,
            self._is_invalid(STATE),
            self._is_invalid(REFERENCE),
            is_implausible,
            None if preview is None else preview.content,
            feedback,
            mission is not None and not mission.content.is_engaged,
        )

    def _new_feedback(self, now_ns: int) -> ControlInput | None:
        feedback, last = self._inbox.newest_valid(FEEDBACK, now_ns), self._last_feedback
        self._last_feedback = feedback
        return None if feedback is None or feedback is last else feedback.content

    def state_age_ns(self, now_ns: int) -> int | None:
        """Age of the newest state, its extra transport delay included; None before the first."""
        if self._last_state is None:
            return None
        return now_ns - self._last_state.arrival_ns + self._last_delay_ns

    def bus_fault(self) -> StopCause:
        """What is wrong with the bus or with the other participants on it; NONE if nothing is."""
        inbox = self._inbox
        if self._catalogue.is_another(inbox.newest(VEHICLE_IDENTITY)):
            return StopCause.PEER_MISMATCH
        if inbox.last_failure:
            return StopCause.BUS_FAILED
        if inbox.foreign_frames > 0:
            return StopCause.SECOND_CONTROLLER
        return StopCause.NONE

    @property
    def bus_state(self) -> BusState:
        """What the CAN controller reports of itself."""
        return self._inbox.condition.state

    def state_loss(self) -> StopCause:
        """The cause if no state arrives: the condition of the bus, or STATE_LOST."""
        return _STATE_LOSS.get(self.bus_state, StopCause.STATE_LOST)

    def _is_invalid(self, message: Message[Any]) -> bool:
        """True if frames of this message that may not be used were received since the last call."""
        before = self._last_out_of_range[message]
        self._last_out_of_range[message] = self._inbox.out_of_range(message)
        return self._last_out_of_range[message] > before

    def _is_in_time(self, state: Received[StateSample], now_ns: int) -> bool:
        # Its age counts from its arrival, also if it was read before the tick.
        age_ns = now_ns - state.arrival_ns + self._last_delay_ns
        return age_ns <= STATE_MAX_AGE_NS

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
