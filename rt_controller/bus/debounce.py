"""Messages that need a second one: a repetition, or the heartbeat of a command.

A single frame of a foreign device, or a replayed one, must neither end a drive nor stop it.
"""

from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.messages import Command, Heartbeat, Identity, Mission
from rt_controller.bus.receive import Received
from rt_controller.contract.timing import COUNTER_MODULUS

DISENGAGED_FRAMES = 3
"""MISSION frames in a row without Engage that end a mission: 200 ms after the first one"""
MISMATCHED_FRAMES = 2
"""IDENT frames in a row with another hash: 1 s after the first one"""


class Engagement:
    """The request of the vehicle; engaged until several frames in a row have Engage = 0."""

    def __init__(self) -> None:
        self._last: Received[Mission] | None = None
        self._is_engaged = False
        self._disengaged = 0

    def confirmed(self, mission: Received[Mission]) -> Mission:
        """The newest mission, engaged as long as its end is not confirmed; call it every period."""
        if mission is not self._last:
            self._last = mission
            self._disengaged = 0 if mission.content.is_engaged else self._disengaged + 1
            if self._disengaged == 0 or self._disengaged >= DISENGAGED_FRAMES:
                self._is_engaged = mission.content.is_engaged
        return mission.content._replace(is_engaged=self._is_engaged)


class PeerCatalogue:
    """Whether the other end uses another message catalogue."""

    def __init__(self, is_fd: bool) -> None:
        self._own = dbc_hash(is_fd)
        self._last: Received[Identity] | None = None
        self._mismatched = 0

    def is_another(self, identity: Received[Identity] | None) -> bool:
        """True if the newest identities in a row had another hash; call it every period."""
        if identity is not None and identity is not self._last:
            self._last = identity
            is_same = identity.content.dbc_hash == self._own
            self._mismatched = 0 if is_same else self._mismatched + 1
        return self._mismatched >= MISMATCHED_FRAMES


def is_heartbeat_of(heartbeat: Received[Heartbeat], command: Received[Command]) -> bool:
    """True if a heartbeat was sent with a command: the same counter and mode in both."""
    return (
        heartbeat.counter == command.counter
        and (heartbeat.content.state_counter - command.counter) % COUNTER_MODULUS == 0
        and heartbeat.content.mode is command.content.mode
    )
