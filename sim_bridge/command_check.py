"""The vehicle's check of received commands: which one is followed, and why others are refused."""

from collections.abc import Iterator

from rt_controller.bus.catalogue import COMMAND, CONTROLLER_IDENTITY, HEARTBEAT
from rt_controller.bus.contents import NO_REFUSAL, Command, Refusal
from rt_controller.bus.end_to_end.assembly import Received
from rt_controller.bus.end_to_end.confirmation import PeerCatalogue, is_heartbeat_of
from rt_controller.bus.inbox import Inbox
from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.contract.timing import COMMAND_TIMEOUT_TICKS, counter_lag
from rt_controller.gateway.vehicle_envelope import OwnMotion, refusals

FOREIGN_TICKS = COMMAND_TIMEOUT_TICKS
"""ticks in a row with frames of another vehicle after which commands are refused: the controller
cannot distinguish the states of the two"""


class CommandCheck:
    """Takes the newest command in each tick, if it may be followed; it never raises."""

    def __init__(self, is_fd: bool, has_envelope: bool = True) -> None:
        """`is_fd`: of the bus; `has_envelope`: commands outside of the envelope are refused."""
        self._has_envelope = has_envelope
        self.accepted: Received[Command] | None = None
        """the newest command that may be followed; its counter is that of the state it answers"""
        self.refusals = NO_REFUSAL
        """of this tick; none if a command was accepted, or no new one arrived"""
        self.ticks_by_refusal = dict.fromkeys(Refusal, 0)
        self._newest: Received[Command] | None = None
        self._periods = 0
        """since the last accepted command"""
        self._catalogue = PeerCatalogue(is_fd)
        self._foreign_frames = 0
        self._foreign_ticks = 0

    def take(
        self,
        inbox: Inbox,
        now_ns: int,
        state_counter: int,
        motion: OwnMotion,
    ) -> None:
        """Check the frames that were received for this tick.

        Args:
            inbox: of the vehicle, after reading.
            now_ns: of this tick.
            state_counter: of the newest state that was sent.
            motion: of the car, by its own measurement.
        """
        self._periods += 1
        newest = inbox.newest(COMMAND)
        is_new = newest is not self._newest
        self._newest = newest
        self.refusals = self._source(inbox, now_ns)
        if is_new and not self.refusals and inbox.newest_valid(COMMAND, now_ns) is not None:
            self.refusals = self._check_newest(inbox, now_ns, state_counter, motion)
        for refusal in self.refusals:
            self.ticks_by_refusal[refusal] += 1

    def named(self) -> Iterator[tuple[str, int]]:
        """Name and number of ticks of each refusal that occurred."""
        return ((each.name or "", ticks) for each, ticks in self.ticks_by_refusal.items() if ticks)

    def _source(self, inbox: Inbox, now_ns: int) -> Refusal:
        """SOURCE while controllers contradict each other, or another vehicle goes on sending."""
        is_foreign = inbox.foreign_frames > self._foreign_frames
        self._foreign_frames = inbox.foreign_frames
        self._foreign_ticks = self._foreign_ticks + 1 if is_foreign else 0
        is_ambiguous = (
            self._foreign_ticks >= FOREIGN_TICKS
            or self._catalogue.is_another(inbox.newest(CONTROLLER_IDENTITY))
            or inbox.has_conflict(COMMAND, now_ns)
            or inbox.has_conflict(HEARTBEAT, now_ns)
        )
        return Refusal.SOURCE if is_ambiguous else NO_REFUSAL

    def _check_newest(
        self, inbox: Inbox, now_ns: int, state_counter: int, motion: OwnMotion
    ) -> Refusal:
        """Accept the newest command, or return why it is refused."""
        command, heartbeat = inbox.newest(COMMAND), inbox.newest_valid(HEARTBEAT, now_ns)
        if command is None or heartbeat is None or not is_heartbeat_of(heartbeat, command):
            return Refusal.HEARTBEAT
        answered = heartbeat.content.state_counter
        if counter_lag(newer=state_counter, older=answered) >= COMMAND_TIMEOUT_TICKS:
            return Refusal.LATE
        before, periods = NEUTRAL_INPUT, self._periods
        if self.accepted is not None:
            before = self.accepted.content.control
            # If the vehicle skipped ticks, the controller may have sent several commands.
            periods = max(periods, counter_lag(newer=answered, older=self.accepted.counter))
        found = NO_REFUSAL
        if self._has_envelope:
            found = refusals(command.content, before, periods, motion)
        if not found:
            self.accepted, self._periods = command._replace(counter=answered), 0
        return found
