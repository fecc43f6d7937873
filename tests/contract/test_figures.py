"""A `--json` that cannot be written is refused before the run; the figures are valid JSON."""

import json
import math
import os
from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.figures import require_writable, write_figures


def test_the_check_makes_no_file(tmp_path: Path) -> None:
    require_writable(tmp_path / "figures.json")
    assert list(tmp_path.iterdir()) == []


def test_the_check_does_not_change_a_file(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    path.write_text("of an earlier run")
    require_writable(path)
    assert path.read_text() == "of an earlier run"


def test_without_a_path_nothing_is_written() -> None:
    require_writable(None)
    write_figures(None, {"figure": 1.0})


@pytest.mark.parametrize(
    ("name", "obstacle"),
    [
        ("nowhere/figures.json", "no folder"),
        (".", "a folder of that name"),
        ("file/figures.json", "no folder"),
        ("x" * 300, "name too long"),
        ("loop", "symbolic links"),
    ],
)
def test_a_path_that_cannot_be_written_is_refused_with_the_reason(
    tmp_path: Path, name: str, obstacle: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(ConfigError, match="--json") as error:
        require_writable(tmp_path / name)
    assert obstacle in str(error.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is closed to the superuser")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    with pytest.raises(ConfigError, match="closed to writing"):
        require_writable(closed / "figures.json")


def test_figures_are_read_back_with_null_for_numbers_that_are_not_finite(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    write_figures(path, {"a": 1.5, "b": math.inf, "c": {"d": [1, math.nan]}, "e": None})
    text = path.read_text()
    assert json.loads(text) == {"a": 1.5, "b": None, "c": {"d": [1, None]}, "e": None}
    assert "NaN" not in text


def test_a_folder_that_was_removed_during_the_run_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RtControllerError, match="only this file is missing"):
        write_figures(tmp_path / "gone" / "figures.json", {"a": 1})
