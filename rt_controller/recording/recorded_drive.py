"""A recorded drive: the frames of a log, joined with the ticks of its journal."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, repeat
from pathlib import Path
from typing import Any, NamedTuple

import can

from rt_controller.bus.log.log_file import SUFFIX
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import open_regular
from rt_controller.mapping.log_damage import (
    explain_candump_line,
    explain_damage,
    is_candump_line,
)
from rt_controller.recording.journal import (
    RECEIVED,
    SENT,
    Call,
    JournalTick,
    is_replayed,
    read_journal,
)

_ERROR_FLAG = 0x2000_0000
"""of an identifier in a candump log"""
_COPY_AGAIN = (
    "Copy it again together with its journal; a file that was cut off or damaged cannot be "
    "replayed."
)


class RecordedCall(NamedTuple):
    """A call before the end of a tick, with the frames that it read or sent."""

    call: Call
    frames: tuple[can.Message, ...] = ()


class RecordedTick(NamedTuple):
    """A tick as it was recorded."""

    journal: JournalTick
    calls: tuple[RecordedCall, ...]

    def frames(self, name: str) -> list[can.Message]:
        """All frames that were received, or sent, before the end of the tick."""
        return [frame for each in self.calls if each.call.name == name for frame in each.frames]


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """Header and ticks of a log and its journal."""

    path: Path
    header: Mapping[str, Any]
    ticks: tuple[RecordedTick, ...]
    """the last one may have the number -1: calls after the last tick"""

    @property
    def is_fd(self) -> bool:
        """True if the bus had frames of CAN FD."""
        return bool(self.header.get("is_fd", False))

    @property
    def driven_ticks(self) -> int:
        """Number of ticks."""
        return sum(tick.journal.number >= 0 for tick in self.ticks)

    @property
    def incomplete_from(self) -> int | None:
        """Number of the first tick before whose end something was dropped; None: nothing was."""
        for expected, tick in enumerate(self.ticks):
            number = tick.journal.number
            if tick.journal.dropped or number not in (expected, -1):
                return max(number, 0)
        return None


def read_recorded_drive(path: Path) -> RecordedDrive:
    """The drive that was recorded to this log.

    Raises:
        ConfigError: the log or its journal cannot be read, or they do not belong together.
    """
    header, journal = read_journal(path)
    frames = _frames(path)
    ticks = tuple(
        RecordedTick(tick, tuple(_with_frames(path, call, frames) for call in tick.calls))
        for tick in journal
    )
    return RecordedDrive(path, header, ticks)


def _with_frames(path: Path, call: Call, frames: Iterator[can.Message]) -> RecordedCall:
    if call.name not in (RECEIVED, SENT):
        return RecordedCall(call)
    found = tuple(islice(frames, call.frames))
    if len(found) < call.frames:
        raise ConfigError(
            f"{path}: expected at least the frames that its journal counts, found fewer: one of "
            f"the two was cut off or edited. Copy both again."
        )
    return RecordedCall(call, found)


def _frames(path: Path) -> Iterator[can.Message]:
    """The frames with data, in the order of the log."""
    n_frames = 0
    try:
        open_regular(path).close()  # a pipe is not waited for
        with can.LogReader(path) as reader:
            for is_error, frame in zip(_error_marks(path), reader, strict=False):
                n_frames += 1
                if is_replayed(frame.is_remote_frame, frame.is_error_frame or is_error):
                    yield frame
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a log that can be read, found {error.strerror}. Correct the path or "
            f"the permissions."
        ) from error
    except ConfigError:
        raise
    except Exception as error:  # python-can's readers raise many types
        raise ConfigError(f"{explain_damage(path, n_frames)}. {_COPY_AGAIN}") from error


def _error_marks(path: Path) -> Iterator[bool]:
    """For each frame of a candump log whether it is an error frame; False for other formats.

    From candump python-can reads only those of one class as error frames, the others as data.

    Raises:
        ConfigError: a line is not one of candump.
    """
    if path.suffix.lower() != SUFFIX:
        yield from repeat(False)
        return
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            if not is_candump_line(line):
                raise ConfigError(f"{explain_candump_line(path, number, line)}. {_COPY_AGAIN}")
            identifier = line.split()[2].partition("#")[0]
            yield len(identifier) == 8 and bool(int(identifier, 16) & _ERROR_FLAG)
