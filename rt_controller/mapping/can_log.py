"""Frames of a CAN log in a file, and where the file is damaged, in words of its format.

Import, `rt-controller signals check` and replay read their logs here. The readers of python-can
stop early in silence at some damages, and raise errors of many types, whose texts describe their
own code, at others.
"""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import can

from rt_controller.contract.errors import ConfigError, DatasetError, RtControllerError
from rt_controller.contract.files import open_regular
from rt_controller.mapping.signal_frames import SignalReader

_CANDUMP_LINE = re.compile(
    r"\(\d+\.\d+\)\s+\S+\s+"
    r"[0-9A-F]{1,8}#"
    r"(#[0-9A-F]([0-9A-F]{2})*|R\d{0,2}|([0-9A-F]{2})*)"
    r"(\s+[RT])?",  # python-can adds the direction
    re.ASCII | re.IGNORECASE,
)
_ERROR_FLAG = 0x20000000
"""bit of the identifiers of candump that marks an error frame"""
_READ_BYTES = 4096
"""from the beginning and from the end of a log in text"""
_COUNTED_FROM_ZERO = (".asc", ".blf")
"""in the readers of python-can; in the files, and in Vector's tools, the first channel is 1"""


class LoggedFrame(NamedTuple):
    """A frame with data, its place in the log, and its channel as the file has it."""

    number: int
    """counted from 1, with frames that have no data"""
    frame: can.Message
    channel: str


def read_frames(path: Path, remedy: str) -> Iterator[LoggedFrame]:
    """The frames with data of a CAN log (.log, .blf, .asc, .trc), in its order.

    Raises:
        ConfigError: it cannot be read.
        DatasetError: it is damaged, truncated, or has relative times; the message ends with
            `remedy`.
    """
    number, suffix = 0, path.suffix.lower()
    try:
        open_regular(path).close()  # a pipe is not waited for
        if problem := _incompleteness(path):
            raise DatasetError(f"{path}: {problem}. {remedy}")
        if suffix == ".log":
            yield from _candump_frames(path, remedy)
            return
        first = 1 if suffix in _COUNTED_FROM_ZERO else 0
        with can.LogReader(path) as reader:
            for number, frame in enumerate(reader, start=1):
                if not (frame.is_remote_frame or frame.is_error_frame):
                    channel: object = frame.channel
                    if isinstance(channel, int):
                        channel += first
                    yield LoggedFrame(number, frame, str(channel))
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a log that can be read, found {error.strerror or error}. Correct "
            f"the path or the permissions."
        ) from error
    except RtControllerError:
        raise
    except Exception as error:  # python-can's readers raise many types
        raise DatasetError(f"{_explain_damage(path, number)}. {remedy}") from error


class Sampled(NamedTuple):
    """A sample of one slot."""

    row: int
    """number of its frame"""
    time_s: float
    number: float
    """in the unit of the DBC; NaN: the car sent no measurement"""


def read_samples(
    frames: Iterable[LoggedFrame],
    reader: SignalReader,
    where: str,
    channel: int | str | None = None,
) -> dict[str, list[Sampled]]:
    """The samples of every slot of `reader`; of two with the same time the later one.

    Args:
        frames: of a log or of a bus.
        reader: of the mapped messages.
        where: the log, for messages.
        channel: other channels are not read; None: all are.

    Raises:
        DatasetError: times go back, or no mapped message is on this channel, but on others.
    """
    tracks: dict[str, list[Sampled]] = {name: [] for name in reader.sources}
    elsewhere = Counter[str]()
    for row, frame, on in frames:
        if channel is not None and on != str(channel):
            elsewhere[on] += reader.has(frame)
            continue
        for name, number in (reader.numbers(frame) or {}).items():
            track, time_s = tracks[name], float(frame.timestamp)
            last_s = track[-1].time_s if track else time_s
            if time_s < last_s:
                raise DatasetError(
                    f"{where}, {reader.sources[name].message.name}, frame {row}: expected time to "
                    f"increase, found {time_s:.6f} s after {last_s:.6f} s. Split the log where "
                    f"time starts again, or choose one channel of the bus."
                )
            if track and time_s == last_s:
                track.pop()
            track.append(Sampled(row, time_s, number))
    if elsewhere.total() and not any(tracks.values()):
        listed = ", ".join(f"{name} ({n})" for name, n in sorted(elsewhere.items()) if n)
        raise DatasetError(
            f"{where}: expected frames of the mapped messages on channel {channel}, found none; "
            f"other channels have them: {listed}. Correct [can] channel."
        )
    return tracks


def _candump_frames(path: Path, remedy: str) -> Iterator[LoggedFrame]:
    """Those of a candump log; python-can would take error frames of most classes for data."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            text = line.strip()
            if not text:
                continue
            if not _CANDUMP_LINE.fullmatch(text):
                shown = text if len(text) <= 80 else f"{text[:80]}…"
                raise DatasetError(
                    f"{path}, line {number}: expected (seconds) channel ID#DATA with ID and DATA "
                    f"in hexadecimal digits, found {shown!r}. {remedy}"
                )
            stamp, channel, content = text.split()[:3]
            digits, _, data = content.partition("#")
            identifier, is_extended = int(digits, 16), len(digits) == 8
            if (is_extended and identifier & _ERROR_FLAG) or data.startswith("R"):
                continue
            is_fd = data.startswith("#")  # with a digit of flags
            frame = can.Message(
                timestamp=float(stamp.strip("()")),
                arbitration_id=identifier,
                is_extended_id=is_extended,
                is_fd=is_fd,
                data=bytes.fromhex(data[2:] if is_fd else data),
            )
            yield LoggedFrame(number, frame, channel)


def _incompleteness(path: Path) -> str:
    """What was expected and found if the file was cut off, or its times are relative.

    The header of a BLF has its length, an ASC has a last line, and all logs in text end every line.
    """
    if path.suffix.lower() == ".blf":
        with can.BLFReader(path) as reader:
            size = int(reader.file_size)
        found_bytes = os.path.getsize(path)
        if found_bytes >= size:
            return ""
        return f"expected {size} bytes as its header says, found {found_bytes}: it is truncated"
    with path.open("rb") as file:
        head = file.read(_READ_BYTES).lower()
        file.seek(max(0, os.path.getsize(path) - _READ_BYTES))
        tail = file.read().lower()
    if not head or b"\0" in head:
        return f"expected lines of text, found {'binary data' if head else 'an empty file'}"
    if b"timestamps relative" in head:
        return (
            "expected times since the beginning, found 'timestamps relative', which count from "
            "the event before: export it with absolute time stamps"
        )
    last = tail.splitlines()[-1].decode("utf-8", "replace")
    has_no_end = b"begin triggerblock" in head and b"end triggerblock" not in tail
    if not has_no_end and (tail.endswith(b"\n") or "end triggerblock" in last):
        return ""
    expected = "a last line 'End TriggerBlock'" if has_no_end else "a complete last line"
    return f"expected {expected}, found {last!r}: it is truncated"


def _explain_damage(path: Path, n_frames: int) -> str:
    """The place, and what was expected and found there, of a log refused after `n_frames`."""
    if n_frames == 0:
        return (
            f"{path}: expected a CAN log in the format of its suffix, found a file without a "
            f"readable first frame: truncated, damaged or in another format"
        )
    return (
        f"{path}, frame {n_frames + 1}: expected a frame in the format {path.suffix}, found "
        f"truncated or damaged bytes after {n_frames} whole frames"
    )
