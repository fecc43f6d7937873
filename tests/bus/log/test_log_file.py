"""Logs on disk: never overwritten unasked, whole records only, opened without waiting."""

import errno
import os
from pathlib import Path

import pytest

from rt_controller.bus.log.log_file import LogFile
from rt_controller.contract.errors import ConfigError

RECORDS = [b"first\n", b"second\n", b"third\n"]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of an earlier drive."""
    path = tmp_path / "drive.log"
    path.write_text("earlier\n")
    return path


def test_an_existing_log_is_refused_and_stays_as_it_is(log: Path) -> None:
    with pytest.raises(ConfigError, match=r"expected no log .* found one.*--overwrite"):
        LogFile(log)
    assert log.read_text() == "earlier\n"


def test_an_existing_log_is_replaced_when_asked_with_the_first_record(log: Path) -> None:
    file = LogFile(log, replaces=True)
    assert log.read_text() == "earlier\n"
    file.append(RECORDS)
    file.close()
    assert log.read_bytes() == b"".join(RECORDS)


def test_a_run_without_records_neither_replaces_a_log_nor_leaves_one(log: Path) -> None:
    LogFile(log, replaces=True).close()
    assert log.read_text() == "earlier\n"
    new = log.with_name("new.log")
    LogFile(new).close()
    assert not new.exists()


def test_a_folder_gets_a_new_log_for_every_run(tmp_path: Path) -> None:
    names = set()
    for _ in range(3):
        file = LogFile(tmp_path)
        file.append(RECORDS)
        file.close()
        names.add(file.path)
    assert len(names) == 3
    assert {path.parent for path in names} == {tmp_path}


def test_a_pipe_without_a_reader_is_refused_instead_of_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match="a pipe that no process reads"):
        LogFile(tmp_path / "pipe")


def test_a_full_disk_keeps_whole_records_and_says_how_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room, write = 9, os.write

    def write_until_full(descriptor: int, data: bytes) -> int:
        nonlocal room
        if room == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = write(descriptor, data[:room])
        room -= written
        return written

    file = LogFile(tmp_path / "drive.log")
    monkeypatch.setattr("rt_controller.bus.log.log_file.os.write", write_until_full)
    assert file.append(RECORDS) == 1
    assert file.failure == "No space left on device"
    room = 100
    assert file.append(RECORDS[1:]) == 2
    file.close()
    assert file.path.read_bytes() == b"".join(RECORDS)
