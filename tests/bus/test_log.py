"""The log: whole records, never overwritten unasked, readable by python-can, never blocking."""

import errno
import os
import time
from collections.abc import Callable
from threading import Event

import can
import pytest

from rt_controller.bus.log import recorder as recorder_module
from rt_controller.bus.log.log_file import LogFile
from rt_controller.bus.log.recorder import Recorder
from rt_controller.contract.errors import ConfigError

RECORDS = [b"first\n", b"second\n", b"third\n"]


def test_an_existing_log_is_replaced_only_when_asked_and_with_the_first_record(tmp_path):
    earlier = tmp_path / "drive.log"
    earlier.write_text("earlier\n")
    with pytest.raises(ConfigError, match=r"expected no file .* found one.*--overwrite"):
        LogFile(earlier)
    LogFile(earlier, replaces=True).close()
    file = LogFile(earlier, replaces=True)
    assert earlier.read_text() == "earlier\n"
    file.append(RECORDS)
    file.close()
    assert earlier.read_bytes() == b"".join(RECORDS)


def test_a_folder_gets_a_new_log_for_every_run(tmp_path):
    names = set()
    for _ in range(3):
        file = LogFile(tmp_path)
        file.append(RECORDS)
        file.close()
        names.add(file.path)
    LogFile(tmp_path).close()  # without records
    assert {*tmp_path.iterdir()} == names
    assert len(names) == 3
    assert {path.parent for path in names} == {tmp_path}


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """A disk with this room in bytes, for all files together."""
    disk, write = {"room": 0}, os.write

    def write_until_full(descriptor: int, data: bytes) -> int:
        if disk["room"] == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = write(descriptor, data[: disk["room"]])
        disk["room"] -= written
        return written

    monkeypatch.setattr("rt_controller.bus.log.log_file.os.write", write_until_full)
    return disk


def test_a_full_disk_keeps_whole_records_and_says_how_many(tmp_path, disk):
    file, disk["room"] = LogFile(tmp_path / "drive.log"), 9
    assert file.append(RECORDS) == 1
    assert file.failure == "No space left on device"
    disk["room"] = 100
    assert file.append(RECORDS[1:]) == 2
    file.close()
    assert file.path.read_bytes() == b"".join(RECORDS)


def message(arbitration_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=data, check=True)


def test_every_kind_of_frame_is_the_line_that_candump_writes_and_is_read_back(tmp_path):
    path, standard = tmp_path / "drive.log", {"is_extended_id": False}
    frames = [
        (can.Message(arbitration_id=0x12345, data=b"\x01"), "00012345#01"),
        (can.Message(arbitration_id=0x42, is_remote_frame=True, **standard), "042#R"),
        (can.Message(arbitration_id=0x84, is_error_frame=True, data=b"\x02"), "20000084#02"),
        (
            can.Message(arbitration_id=0x43, is_fd=True, data=bytes(12), **standard),
            f"043##0{24 * '0'}",
        ),
        (message(0x100, bytes.fromhex("01A2030405060708")), "100#01A2030405060708"),
        (message(0x7, b""), "007#"),
    ]
    with Recorder(path, "my bus", is_lockstep=True) as recorder:
        for tick, (frame, _) in enumerate(frames):
            recorder.record(frame, 25_000_099 * tick)
    assert path.read_text().splitlines() == [
        f"(0.{25_000 * tick:06d}) my_bus {line}" for tick, (_, line) in enumerate(frames)
    ]
    for (sent, _), read in zip(frames, can.CanutilsLogReader(path), strict=True):
        for kind in ("is_extended_id", "is_remote_frame", "is_error_frame", "is_fd"):
            assert getattr(sent, kind) == getattr(read, kind)
        assert read.is_error_frame or (read.data, read.channel) == (sent.data, "my_bus")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("pipe.log", "expected a file .* found No such device"),
        ("missing/drive.log", r"expected a file .* found .*Name another"),
        *((f"drive{each}", r"suffix \.log.*can_logconvert") for each in ("", ".ASC", ".mcap")),
    ],
)
def test_a_file_that_cannot_be_such_a_log_is_refused(tmp_path, name, expected):
    os.mkfifo(tmp_path / "pipe.log")
    with pytest.raises(ConfigError, match=expected):
        Recorder(tmp_path / name, "can0", is_lockstep=False)
    assert [each.name for each in tmp_path.iterdir()] == ["pipe.log"]


def write_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "_WRITE_INTERVAL_S", 0.001)


def wait_until(condition: Callable[[], object]) -> None:
    for _ in range(10_000):
        if condition():
            return
        time.sleep(0.001)
    pytest.fail("expected the writer to have written")


def test_the_writer_writes_while_the_drive_goes_on(tmp_path, monkeypatch):
    """So the log of a killed controller lacks only the last frames."""
    write_often(monkeypatch)
    path = tmp_path / "drive.log"
    with Recorder(path, "can0", is_lockstep=False) as recorder:
        recorder.record(message(0x100, b"\x01"), 0)
        wait_until(path.read_text)
        assert path.read_text().endswith(" can0 100#01\n")


def test_a_message_may_change_after_it_was_recorded(tmp_path):
    path = tmp_path / "drive.log"
    reused = message(0x100, bytes(8))
    with Recorder(path, "can0", is_lockstep=False) as recorder:
        for value in (1, 2, 3):
            reused.data[0] = value
            recorder.record(reused, 0)
    assert [each.data[0] for each in can.CanutilsLogReader(path)] == [1, 2, 3]


@pytest.mark.parametrize("is_lockstep", [False, True])
@pytest.mark.usefixtures("disk")
def test_a_full_disk_does_not_end_the_drive(tmp_path, monkeypatch, is_lockstep):
    write_often(monkeypatch)
    with Recorder(tmp_path / "full.log", "can0", is_lockstep=is_lockstep) as recorder:
        for _ in range(2000):
            recorder.record(message(0x100, bytes(8)), 0)
        wait_until(lambda: recorder.last_failure)
    assert "No space left" in recorder.last_failure
    assert (recorder.written, recorder.dropped) == (0, 2000)
    assert "2000 frames are missing" in recorder.new_failure()
    assert recorder.new_failure() == ""
    recorder.close()


@pytest.mark.parametrize(
    ("is_lockstep", "begins_before_the_end"), [(False, False), (False, True), (True, True)]
)
def test_a_disk_that_does_not_answer_does_not_hold_up_the_end(
    tmp_path, monkeypatch, is_lockstep, begins_before_the_end
):
    answers = Event()
    if begins_before_the_end:
        write_often(monkeypatch)
    monkeypatch.setattr(recorder_module, "LONGEST_CLOSE_S", 0.01)
    monkeypatch.setattr("rt_controller.bus.log.log_file.os.write", lambda *_: answers.wait() or 0)
    recorder = Recorder(tmp_path / "drive.log", "can0", is_lockstep=is_lockstep)
    for _ in range(600):
        recorder.record(message(0x100, bytes(8)), 0)
    if begins_before_the_end:
        wait_until(lambda: len(recorder._queue) < 600)
    recorder.close()
    assert (recorder.written, recorder.dropped) == (0, 600)
    assert "too slow" in recorder.explain_failure()
    monkeypatch.undo()
    answers.set()


def test_a_disk_that_stalls_delays_no_frame(tmp_path, monkeypatch):
    """`record` returns while the writer waits; what it took meanwhile is written afterwards."""
    is_stalled, answers, write = Event(), Event(), os.write

    def stall(descriptor, data):
        is_stalled.set()
        assert answers.wait(60.0)
        return write(descriptor, data)

    write_often(monkeypatch)
    monkeypatch.setattr("rt_controller.bus.log.log_file.os.write", stall)
    with Recorder(tmp_path / "drive.log", "can0", is_lockstep=False) as recorder:
        recorder.record(message(0x100, b""), 0)
        assert is_stalled.wait(60.0)
        for _ in range(2000):
            recorder.record(message(0x100, bytes(8)), 0)
        assert recorder.written == 0
        answers.set()
    assert (recorder.written, recorder.dropped, recorder.explain_failure()) == (2001, 0, "")


@pytest.mark.parametrize(("is_lockstep", "written"), [(True, 100), (False, 8)])
def test_a_drive_in_lockstep_waits_for_a_slow_disk_and_no_other_does(
    tmp_path, monkeypatch, is_lockstep, written
):
    monkeypatch.setattr(recorder_module, "_WRITE_INTERVAL_S", 0.001 if is_lockstep else 60.0)
    path = tmp_path / "slow.log"
    with Recorder(path, "can0", is_lockstep=is_lockstep, capacity=8) as recorder:
        for _ in range(100):
            recorder.record(message(0x100, bytes(8)), 0)
    assert (recorder.written, recorder.dropped) == (written, 100 - written)
