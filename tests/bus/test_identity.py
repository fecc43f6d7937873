"""Controller and vehicle accept each other only with the same message catalogue."""

import hashlib

import pytest

from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.identity import (
    dbc_hash,
    hash_of_catalogue,
    leading_digits,
    model_hash,
    require_same_catalogue,
)
from rt_controller.bus.messages import Identity
from rt_controller.contract.errors import BusError

TEXT = DBC_PATH.read_text(encoding="ascii")


def test_the_hash_ignores_line_ends_and_trailing_blanks() -> None:
    assert hash_of_catalogue(TEXT) == dbc_hash()
    assert hash_of_catalogue(TEXT.replace("\n", "\r\n")) == dbc_hash()
    assert hash_of_catalogue(TEXT.replace("\n", "  \n\n") + "\n\n") == dbc_hash()


def test_the_hash_changes_with_any_scale() -> None:
    assert "(0.005,0)" in TEXT
    assert hash_of_catalogue(TEXT.replace("(0.005,0)", "(0.0050001,0)")) != dbc_hash()


def test_the_hash_is_the_beginning_of_the_sha_256_of_the_normal_text() -> None:
    """So that any other program can compute it."""
    digest = hashlib.sha256(b"A\n B\n").hexdigest()
    assert f"{hash_of_catalogue('A  ' + chr(10) * 2 + ' B'):08x}" == digest[:8]


def test_hashes_never_have_the_value_of_not_available() -> None:
    assert model_hash("ffff0") == 0xFFFE
    assert model_hash("fffe0") == 0xFFFE
    assert model_hash("00010") == 1
    assert leading_digits("f" * 64, 8) == 0xFFFF_FFFE


def test_a_peer_with_another_catalogue_is_refused() -> None:
    require_same_catalogue(Identity(dbc_hash(), None))
    peer = Identity(dbc_hash() ^ 1, None)
    with pytest.raises(BusError, match=r"expected .* found .*one version"):
        require_same_catalogue(peer)
