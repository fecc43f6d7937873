"""Files are replaced as a whole, and read if they have a reasonable size; no cache is needed."""

import errno
import os
import resource
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.files import (
    atomic_write,
    open_regular,
    read_text,
    user_cache_folder,
    write_text,
)


def test_an_endless_device_is_no_regular_file() -> None:
    with pytest.raises(OSError, match="Not a regular file"):
        open_regular(Path("/dev/zero"))


def test_a_file_within_the_limit_is_read(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.arange(3))
    with open_regular(tmp_path / "a.npy", 1000) as file:
        assert np.load(file).tolist() == [0, 1, 2]


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process can become longer than 100 bytes: EFBIG in place of ENOSPC."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_without_room_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    file.write_text("of an earlier run")
    with full_disk(), pytest.raises(OSError, match="too large") as refused:
        write_text(file, "x" * 1000)
    assert refused.value.errno == errno.EFBIG
    assert refused.value.filename == str(file)
    assert file.read_text() == "of an earlier run"
    assert list(tmp_path.iterdir()) == [file]


def test_a_replaced_file_keeps_its_permissions_and_a_link_stays_one(tmp_path: Path) -> None:
    file, link = tmp_path / "figures.json", tmp_path / "latest.json"
    file.touch(mode=0o600)
    link.symlink_to(file.name)
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert file.stat().st_mode & 0o777 == 0o600


def test_a_link_that_leads_to_itself_does_not_lose_the_content(tmp_path: Path) -> None:
    loop = tmp_path / "figures.json"
    loop.symlink_to(loop.name)
    write_text(loop, "new")
    assert loop.read_text() == "new"


def test_a_name_of_the_longest_length_is_written(tmp_path: Path) -> None:
    write_text(tmp_path / ("x" * 255), "new")
    assert (tmp_path / ("x" * 255)).read_text() == "new"


def test_a_device_and_a_pipe_are_written_in_place(tmp_path: Path) -> None:
    write_text(Path("/dev/null"), "new")
    assert Path("/dev/null").is_char_device()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)
    assert pipe.is_fifo()


def test_a_pipe_without_a_reader_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="a pipe that no process reads"):
        write_text(tmp_path / "pipe", "new")


def test_a_pipe_that_is_not_read_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rt_controller.contract.files._LONGEST_STALL_S", 0.01)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with pytest.raises(OSError, match="a pipe that is not read") as refused:
        write_text(pipe, "0123456789" * 100_000)
    os.close(reader)
    assert refused.value.filename == str(pipe)


def test_a_pipe_that_is_read_slowly_gets_everything(tmp_path: Path) -> None:
    pipe, text = tmp_path / "pipe", "0123456789" * 30_000
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    os.set_blocking(reader, True)
    with ThreadPoolExecutor() as threads:
        written = threads.submit(write_text, pipe, text)
        read = b""
        while not written.done():
            read += os.read(reader, 5000)
        written.result()
    while part := os.read(reader, 5000):
        read += part
    os.close(reader)
    assert read.decode() == text


def test_stdout_that_is_a_file_is_not_replaced_by_another_one(tmp_path: Path) -> None:
    with (tmp_path / "out.txt").open("w") as out:
        write_text(Path(f"/dev/fd/{out.fileno()}"), "new")
        assert os.fstat(out.fileno()).st_nlink == 1
    assert (tmp_path / "out.txt").read_text() == "new"


def test_an_exception_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "figures.json"
    file.write_text("of an earlier run")
    with pytest.raises(TypeError), atomic_write(file) as stream:
        stream.writelines([b"half", "no bytes"])  # type: ignore[list-item]
    assert file.read_text() == "of an earlier run"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("content", [b"\xef\xbb\xbfa\nb", b"a\r\nb", b"a\rb", b"a\nb"])
def test_a_text_is_read_with_a_byte_order_mark_and_with_any_line_ends(
    tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "a.toml").write_bytes(content)
    assert read_text(tmp_path / "a.toml") == "a\nb"


def test_a_text_of_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.toml")
    with pytest.raises(OSError, match="Not a regular file"):
        read_text(tmp_path / "a.toml")


def test_the_cache_folder_is_made_or_missing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
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
