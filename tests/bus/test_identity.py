"""Controller and vehicle accept each other only with the same message catalogue."""

import hashlib

import pytest

from rt_controller.bus.catalogue import Identity
from rt_controller.bus.codec import DBC_PATH
from rt_controller.bus.identity import (
    dbc_hash,
    hash_of_catalogue,
    model_hash,
    require_same_catalogue,
)
from rt_controller.contract.errors import BusError

TEXT = DBC_PATH.read_text(encoding="ascii")


def test_the_hash_ignores_line_ends_and_trailing_blanks() -> None:
    assert hash_of_catalogue(TEXT) == dbc_hash()
    assert hash_of_catalogue(TEXT.replace("\n", "\r\n")) == dbc_hash()
    assert hash_of_catalogue(TEXT.replace("\n", "  \n\n") + "\n\n") == dbc_hash()


def test_the_hash_changes_with_any_scale() -> None:
    assert "(0.005,0)" in TEXT
    assert hash_of_catalogue(TEXT.replace("(0.005,0)", "(0.0050001,0)")) != dbc_hash()


def test_the_hash_is_sha_256_of_the_normal_text() -> None:
    """So that any other program can compute it."""
    digest = hashlib.sha256(b"A\n B\n").hexdigest()
    assert hash_of_catalogue("A  \n\n B") == int(digest, 16) % (2**32 - 1)


def test_hashes_never_have_the_value_of_not_available() -> None:
    assert dbc_hash() < 0xFFFF_FFFF
    assert model_hash("ffff") == 0
    assert model_hash(hashlib.sha256(b"model").hexdigest()) < 0xFFFF


def test_a_peer_with_the_same_catalogue_is_accepted() -> None:
    require_same_catalogue(Identity(dbc_hash(), None))


def test_a_peer_with_another_catalogue_is_refused() -> None:
    peer = Identity(dbc_hash() ^ 1, None)
    with pytest.raises(BusError, match=r"expected .* found .*one version"):
        require_same_catalogue(peer)
