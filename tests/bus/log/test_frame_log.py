"""Logs in the formats of python-can's writers hold the same frames as the candump log."""

import logging
from pathlib import Path

import can
import pytest

from rt_controller.bus.log.frame_log import RecordedFrame, open_frame_log, use_asammdf
from rt_controller.bus.log.recorder import Recorder

FRAMES = [
    RecordedFrame(25_000_000 * tick, is_sent, 0x100 + tick, False, False, False, False, bytes(8))
    for tick in range(1, 40)
    for is_sent in (False, True)
]


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc", ".mf4"])
def test_python_can_reads_the_frames_back_in_their_order(tmp_path: Path, suffix: str) -> None:
    if suffix == ".mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"drive{suffix}"
    log = open_frame_log(path, "vcan0", epoch_offset_ns=1_700_000_000_000_000_000)
    assert log.append(FRAMES) == len(FRAMES)
    log.close()
    with can.LogReader(path) as reader:
        read = list(reader)
    assert [(each.arbitration_id, each.data) for each in read] == [
        (frame.identifier, frame.data) for frame in FRAMES
    ]
    if suffix != ".log":  # candump has no direction
        assert [each.is_rx for each in read] == [not frame.is_sent for frame in FRAMES]
    # ASC counts from its first frame.
    first_s = read[0].timestamp - FRAMES[0].stamp_ns * 1e-9
    times_s = [each.timestamp - first_s for each in read]
    assert times_s == pytest.approx([frame.stamp_ns * 1e-9 for frame in FRAMES], abs=1e-4)


def test_a_drive_in_simulated_time_begins_in_1970(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    path = tmp_path / "drive.mf4"
    log = open_frame_log(path, "rt-controller")
    log.append(FRAMES[:1])
    log.close()
    with can.LogReader(path) as reader:
        (read,) = reader
    assert read.timestamp == pytest.approx(0.025, abs=1e-4)


def test_what_asammdf_raises_is_not_printed_too(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    use_asammdf(tmp_path / "drive.mf4")
    assert not logging.getLogger("asammdf").isEnabledFor(logging.ERROR)


def test_a_file_that_cannot_be_completed_has_no_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(can.BLFWriter, "stop", stop)
    with Recorder(tmp_path / "drive.blf", "vcan0", is_lockstep=True) as recorder:
        for tick in range(7):
            recorder.record(can.Message(arbitration_id=tick), tick)
    assert (recorder.written, recorder.dropped) == (0, 7)
    assert "7 frames are missing" in recorder.explain_failure()
