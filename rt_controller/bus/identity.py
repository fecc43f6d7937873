"""Identity of the two programs on the bus: hashes by which each checks the other."""

import hashlib
from functools import cache

from rt_controller.bus.dbc import dbc_path
from rt_controller.bus.messages import Identity
from rt_controller.contract.errors import BusError

DBC_HASH_DIGITS = 8
MODEL_HASH_DIGITS = 4


def leading_digits(sha256_hex: str, digits: int) -> int:
    """The number that the first hexadecimal digits form, as the bus carries it.

    One less if all are f, because that number means "not available" on the bus.
    """
    return min(int(sha256_hex[:digits], 16), (1 << 4 * digits) - 2)


@cache
def dbc_hash(is_fd: bool = False) -> int:
    """32-bit hash of this program's message catalogue: of classic CAN, or of CAN FD."""
    return hash_of_catalogue(dbc_path(is_fd).read_text(encoding="ascii"))


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


def own_identity(model: int | None, is_fd: bool = False) -> Identity:
    """Identity of this program with the model of this hash, or without a model."""
    return Identity(dbc_hash(is_fd), model)


def require_same_catalogue(peer: Identity, is_fd: bool = False) -> None:
    """Return if the other end of the bus uses the same message catalogue.

    Raises:
        BusError: it uses another one.
    """
    expected = dbc_hash(is_fd)
    if peer.dbc_hash != expected:
        raise BusError(
            f"the other end of the bus: expected the message catalogue {expected:08x}, found "
            f"{peer.dbc_hash:08x}. Run controller and vehicle from one version (their "
            f"messages.dbc and messages_fd.dbc must be the same files)."
        )
