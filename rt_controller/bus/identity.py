"""Identity of the two programs on the bus: hashes by which each checks the other."""

import hashlib
from functools import cache

from rt_controller.bus.catalogue import Identity
from rt_controller.bus.codec import DBC_PATH
from rt_controller.contract.errors import BusError

# All ones means "not available" on the bus, so no hash may have that value.
_DBC_HASHES = 2**32 - 1
_MODEL_HASHES = 2**16 - 1


@cache
def dbc_hash() -> int:
    """32-bit hash of this program's message catalogue.

    SHA-256 of the DBC, read as a big-endian number, modulo 2^32 - 1. Trailing blanks and empty
    lines are left out and every line ends in one line feed, so that a checkout with other line
    ends keeps its hash.
    """
    return hash_of_catalogue(DBC_PATH.read_text(encoding="ascii"))


def hash_of_catalogue(text: str) -> int:
    """32-bit hash of a DBC's text, see `dbc_hash`."""
    lines = (line.rstrip() for line in text.splitlines())
    normal = "".join(f"{line}\n" for line in lines if line)
    digest = hashlib.sha256(normal.encode("ascii")).digest()
    return int.from_bytes(digest, "big") % _DBC_HASHES


def model_hash(sha256_hex: str) -> int:
    """16-bit hash of a model for IDENT_CONTROLLER: its SHA-256 modulo 2^16 - 1."""
    return int(sha256_hex, 16) % _MODEL_HASHES


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
