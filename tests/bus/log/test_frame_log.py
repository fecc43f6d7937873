"""The candump log holds the frames in their order; other formats are converted from it."""

from pathlib import Path

import can
import pytest

from rt_controller.bus.log.frame_log import CandumpLog, RecordedFrame
from rt_controller.contract.errors import ConfigError

FRAMES = [
    RecordedFrame(25_000_000 * tick, is_sent, 0x100 + tick, False, False, False, False, bytes(8))
    for tick in range(1, 40)
    for is_sent in (False, True)
]


def test_python_can_reads_the_frames_back_in_their_order(tmp_path: Path) -> None:
    path = tmp_path / "drive.log"
    log = CandumpLog(path, "vcan0", epoch_offset_ns=1_700_000_000_000_000_000)
    assert log.append(FRAMES) == len(FRAMES)
    log.close()
    with can.LogReader(path) as reader:
        read = list(reader)
    assert [(each.arbitration_id, each.data) for each in read] == [
        (frame.identifier, frame.data) for frame in FRAMES
    ]
    times_s = [each.timestamp - 1_700_000_000 for each in read]
    assert times_s == pytest.approx([frame.stamp_ns * 1e-9 for frame in FRAMES], abs=1e-4)


@pytest.mark.parametrize("suffix", [".blf", ".ASC", ".mf4", ".trc"])
def test_another_format_is_refused_with_the_command_that_converts(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"drive{suffix}"
    with pytest.raises(ConfigError, match=rf"can_logconvert drive\.log drive{suffix.lower()}"):
        CandumpLog(path, "vcan0")
    assert not path.exists()
