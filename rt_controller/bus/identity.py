"""Identity of the two programs on the bus, and messages that need a second one to count."""

import hashlib
from functools import cache

from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import Command, Heartbeat, Identity, Mission
from rt_controller.bus.receive import Received
from rt_controller.contract.errors import BusError
from rt_controller.contract.timing import COUNTER_MODULUS

DBC_HASH_DIGITS = 8
MODEL_HASH_DIGITS = 4


def leading_digits(sha256_hex: str, digits: int) -> int:
    """The number that the first hexadecimal digits form, as the bus carries it.

    One less if all are f, because that number means "not available" on the bus.
    """
    return min(int(sha256_hex[:digits], 16), (1 << 4 * digits) - 2)


@cache
def dbc_hash() -> int:
    """32-bit hash of this program's message catalogue."""
    return hash_of_catalogue(DBC_PATH.read_text(encoding="ascii"))


def hash_of_catalogue(text: str) -> int:
    """32-bit hash of a DBC's text: the first digits of its SHA-256.

    Trailing blanks and empty lines are left out and every line ends in one line feed, so that a
    checkout with other line ends keeps its hash.
    """
    lines = (line.rstrip() for line in text.splitlines())
    normal = "".join(f"{line}\n" for line in lines if line)
    return leading_digits(hashlib.sha256(normal.encode("ascii")).hexdigest(), DBC_HASH_DIGITS)


def model_hash(sha256_hex: str) -> int:
    """16-bit hash of a model for IDENT_CONTROLLER: the first digits of its SHA-256."""
    return leading_digits(sha256_hex, MODEL_HASH_DIGITS)


def own_identity(model: int | None) -> Identity:
    """Identity of this program with the model of this hash, or without a model."""
    return Identity(dbc_hash(), model)


def require_same_catalogue(peer: Identity) -> None:
    """Return if the other end of the bus uses the same message catalogue.

    Raises:
        BusError: it uses another one.
    """
    expected = dbc_hash()
    if peer.dbc_hash != expected:
        raise BusError(
            f"the other end of the bus: expected the message catalogue {expected:08x}, found "
            f"{peer.dbc_hash:08x}. Run controller and vehicle from one version (their "
            f"messages.dbc must be the same file)."
        )


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

    def confirmed(self, mission: Received[Mission]) -> bool:
        """True while the end of the newest mission is not confirmed; call it every period."""
        if mission is not self._last:
            self._last = mission
            self._disengaged = 0 if mission.content.is_engaged else self._disengaged + 1
            if self._disengaged == 0 or self._disengaged >= DISENGAGED_FRAMES:
                self._is_engaged = mission.content.is_engaged
        return self._is_engaged


class PeerCatalogue:
    """Whether the other end uses another message catalogue."""

    def __init__(self) -> None:
        self._own = dbc_hash()
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
