"""Files are replaced as a whole or refused with the reason; no cache is needed."""

import errno
import json
import math
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rt_controller.contract import errors
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.files import atomic_write, read_text, user_cache_folder, write_text


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process can become longer than 100 bytes: EFBIG in place of ENOSPC."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_without_room_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "figures.json"
    file.write_text("of an earlier run")
    with full_disk(), pytest.raises(OSError, match="too large") as refused:
        write_text(file, "x" * 1000)
    assert refused.value.errno == errno.EFBIG
    assert refused.value.filename == str(file)
    assert file.read_text() == "of an earlier run"
    assert list(tmp_path.iterdir()) == [file]


def test_a_replaced_file_keeps_its_permissions_and_a_link_stays_one(tmp_path):
    file, link = tmp_path / "figures.json", tmp_path / "latest.json"
    file.touch(mode=0o600)
    link.symlink_to(file.name)
    for name in ("x" * 255, "loop"):
        (tmp_path / "loop").unlink(missing_ok=True)
        (tmp_path / "loop").symlink_to("loop")
        write_text(tmp_path / name, "new")
        assert (tmp_path / name).read_text() == "new"
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert file.stat().st_mode & 0o777 == 0o600


def test_stdout_that_is_a_file_is_not_replaced_by_another_one(tmp_path):
    write_text(Path("/dev/null"), "new")
    assert Path("/dev/null").is_char_device()
    with (tmp_path / "out.txt").open("w") as out:
        write_text(Path(f"/dev/fd/{out.fileno()}"), "new")
        assert os.fstat(out.fileno()).st_nlink == 1
    assert (tmp_path / "out.txt").read_text() == "new"


def test_an_exception_leaves_the_file_as_it_was(tmp_path):
    file = tmp_path / "figures.json"
    file.write_text("of an earlier run")
    with pytest.raises(TypeError), atomic_write(file) as stream:
        stream.writelines([b"half", "no bytes"])
    assert file.read_text() == "of an earlier run"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_text_is_read_with_a_byte_order_mark_and_with_any_line_ends(tmp_path, encoding, end):
    (tmp_path / "a.toml").write_bytes(f"x, °{end}1".encode(encoding))
    assert read_text(tmp_path / "a.toml") == "x, °\n1"
    os.mkfifo(tmp_path / "pipe")
    for never_read in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(OSError, match="Not a regular file"):
            read_text(never_read)


def test_the_cache_folder_is_made_or_missing(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert user_cache_folder() == tmp_path / "cache" / "rt-controller"
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert user_cache_folder() is None
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", raise_no_home)
    assert user_cache_folder() is None


def raise_no_home() -> Path:
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize(
    ("name", "obstacle"),
    [
        ("nowhere/figures.json", "no folder"),
        (".", "a folder of that name"),
        ("file/figures.json", "no folder"),
        ("x" * 300, "name too long"),
        ("loop", "symbolic links"),
        ("pipe", "a named pipe"),
    ],
)
def test_a_path_that_cannot_be_written_is_refused_with_the_reason(tmp_path, name, obstacle):
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="--json") as error:
        require_writable(tmp_path / name)
    assert obstacle in str(error.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is closed to the superuser")
def test_a_folder_without_permission_is_refused(tmp_path):
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    with pytest.raises(ConfigError, match="closed to writing"):
        require_writable(closed / "figures.json")


def test_figures_are_read_back_with_null_for_numbers_that_are_not_finite(tmp_path):
    path = tmp_path / "figures.json"
    require_writable(path)
    require_writable(None)
    write_figures(None, {"figure": 1.0})
    assert list(tmp_path.iterdir()) == []
    write_figures(path, {"a": 1.5, "b": math.inf, "c": {"d": [1, math.nan]}, "e": None})
    text = path.read_text()
    assert json.loads(text) == {"a": 1.5, "b": None, "c": {"d": [1, None]}, "e": None}
    assert "NaN" not in text


def test_a_folder_that_was_removed_during_the_run_is_an_error(tmp_path):
    with pytest.raises(RtControllerError, match="only this file is missing"):
        write_figures(tmp_path / "gone" / "figures.json", {"a": 1})


def test_an_extra_is_installed_into_a_checkout_or_by_the_name_of_the_package(monkeypatch, tmp_path):
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "rt_controller/contract/errors.py"))
    assert errors.install_command("logs,report") == 'pip install "rt-controller[logs,report]"'
    (tmp_path / "pyproject.toml").touch()
    assert errors.install_command("offline") == 'pip install -e ".[offline]"'
