"""A missing working directory, little memory and a narrow terminal."""

import os
import resource
from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.terminal.surroundings import (
    NARROWEST_COLUMNS,
    explain_lack_of_memory,
    require_surroundings,
)


def test_a_working_directory_that_was_removed_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    with pytest.raises(ConfigError, match="expected a folder, found that it was removed"):
        require_surroundings()


@pytest.mark.parametrize(("found", "used"), [("2", str(NARROWEST_COLUMNS)), ("120", "120")])
def test_text_is_not_wrapped_to_a_few_columns(
    monkeypatch: pytest.MonkeyPatch, found: str, used: str
) -> None:
    monkeypatch.setenv("COLUMNS", found)
    require_surroundings()
    assert os.environ["COLUMNS"] == used


@pytest.mark.parametrize("error", [MemoryError(), ImportError("failed to map segment"), OSError()])
def test_little_memory_is_explained_with_its_limit(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (300 * 2**20, 300 * 2**20))
    assert "found a limit of 300 MiB" in str(explain_lack_of_memory(error))


def test_without_a_limit_an_import_that_fails_is_no_lack_of_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY,) * 2)
    assert explain_lack_of_memory(ImportError("no module")) is None
    assert "found too little" in str(explain_lack_of_memory(MemoryError()))
