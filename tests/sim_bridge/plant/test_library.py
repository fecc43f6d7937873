"""The compiled car is found or compiled; where neither is possible, the message says what to do."""

import ctypes
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.errors import MissingExtraError
from sim_bridge.plant import compiler, library
from sim_bridge.plant.parameters import default_car


@pytest.fixture
def fresh_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installation whose car is not compiled yet; its folder for the car."""
    monkeypatch.setattr(library, "BUILT", tmp_path / "built")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    library.car_library.cache_clear()
    yield tmp_path / "built"
    library.car_library.cache_clear()


def test_the_car_is_compiled_at_the_first_use(fresh_library: Path) -> None:
    assert np.isfinite(library.settle(10.0, default_car())).all()
    assert [file.name for file in fresh_library.iterdir()] == [compiler.car_library_name()]


def test_a_read_only_installation_compiles_into_the_users_cache(
    fresh_library: Path, tmp_path: Path
) -> None:
    fresh_library.write_text("a file, where a folder is expected")
    assert np.isfinite(library.settle(10.0, default_car())).all()
    assert (tmp_path / "cache" / "rt-controller" / "car" / compiler.car_library_name()).exists()


@pytest.mark.parametrize(
    ("cc", "words"),
    [
        ("no-such-compiler --fast", "CC=no-such-compiler, which is no program"),
        ("false", "expected a C99 compiler with the headers of the C library"),
    ],
)
def test_without_a_compiler_the_message_says_what_to_install(
    fresh_library: Path, monkeypatch: pytest.MonkeyPatch, cc: str, words: str
) -> None:
    monkeypatch.setenv("CC", cc)
    with pytest.raises(MissingExtraError, match="apt-get install") as refusal:
        library.settle(10.0, default_car())
    assert words in str(refusal.value)
    assert not list(fresh_library.glob("*"))


@pytest.mark.parametrize(
    "state", [np.zeros(50, dtype=np.float32), np.zeros((50, 2))[:, 0], [0.0] * 50]
)
def test_other_arrays_are_refused_before_the_call(state: object) -> None:
    """A wrong one would be memory that is not ours."""
    with pytest.raises(ctypes.ArgumentError):
        library.car_library().car_settle(10.0, np.zeros(434), state)
