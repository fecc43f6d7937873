"""Logs of a CAN bus, read by python-can and decoded with a DBC by cantools.

The only module of `offline` that imports them: it reads files and opens no bus.
"""

import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import cast

import can
import cantools
import numpy as np
from cantools.database.can import Database

from offline.logs.readers.log import Log, Names, RowsOf, Series, readable
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.mapping.car_file import Source, find_source, load_dbc
from rt_controller.mapping.log_damage import explain_damage
from rt_controller.mapping.tables import CanSettings

_READ_BYTES = 4096
"""from the beginning and from the end of a log in text"""
_Samples = dict[tuple[str, str], list[tuple[int, float, float]]]
"""frame number, time in s and value, by message and signal"""


def read_can(path: Path, wanted: Sequence[Names], settings: CanSettings | None) -> Log:
    """The wanted signals of a CAN log, each with the time stamps of its frames.

    A column is a signal's name, or "Message.Signal" if several messages have a signal of that name.
    """
    if settings is None:
        raise DatasetError(
            f"{path}: expected a DBC to decode the log with, found none in the mapping. Write "
            f'[can] dbc = "car.dbc".'
        )
    database = load_dbc(settings.dbc)
    sources = dict(_find_source(path, database, names) for names in wanted)
    _require_complete(path)
    frames, samples = _decode(path, sources, settings.channel)
    channels, of = [], RowsOf(path, "frame")
    for column, (message, signal) in sources.items():
        if (message.name, signal.name) not in samples:
            where = "" if settings.channel is None else f" on channel {settings.channel}"
            raise DatasetError(
                f"{path}, column {column}: expected frames of {message.name} "
                f"({message.frame_id:#x}), found none among {frames} frames{where}. Check the DBC "
                f"and [can] channel, or leave the file out."
            )
        rows, t_s, values = map(np.array, zip(*samples[message.name, signal.name], strict=True))
        channels.append(Series(column, t_s, values, rows, signal.unit or "", of))
    return Log(path.name, path, tuple(channels), frames)


def _find_source(path: Path, database: Database, names: Names) -> tuple[str, Source]:
    """The first of the names that the DBC has, and its signal."""
    for name in names[:-1]:
        with suppress(ConfigError):
            return name, find_source(str(path), database, name)
    return names[-1], find_source(str(path), database, names[-1])


def _decode(
    path: Path, sources: Mapping[str, Source], channel: int | str | None
) -> tuple[int, _Samples]:
    """Number of frames in the log, and the samples of all signals of the messages."""
    columns = {message.name: column for column, (message, _) in sources.items()}
    by_id = {(each.frame_id, each.is_extended_frame): each for each, _ in sources.values()}
    samples: _Samples = defaultdict(list)
    count = 0
    for count, frame in enumerate(_frames(path), start=1):
        message = by_id.get((frame.arbitration_id, frame.is_extended_id))
        is_elsewhere = channel is not None and str(frame.channel) != str(channel)
        if message is None or is_elsewhere or frame.is_error_frame or frame.is_remote_frame:
            continue
        try:
            decoded = message.decode_simple(bytes(frame.data), decode_choices=False)
        except (cantools.Error, ValueError) as error:
            raise DatasetError(
                f"{path}, column {columns[message.name]}, frame {count}: expected "
                f"{message.length} bytes of {message.name}, found {len(frame.data)} that do not "
                f"decode ({error}). The log may be truncated, or the DBC is of another car."
            ) from error
        for signal, value in decoded.items():
            sample = (count, frame.timestamp, float(cast(float, value)))
            samples[message.name, signal].append(sample)
    return count, samples


def _frames(path: Path) -> Iterator[can.Message]:
    """The frames of the log; every exception of python-can becomes a `DatasetError`."""
    n_frames = 0
    try:
        with readable(path, "a CAN log", (OSError,)), can.LogReader(path) as reader:
            for frame in reader:
                n_frames += 1
                yield frame
    except DatasetError:
        raise
    except Exception as error:  # each reader raises its own types
        raise DatasetError(
            f"{explain_damage(path, n_frames)}. Export or copy it again, or leave it out."
        ) from error


def _require_complete(path: Path) -> None:
    """Return unless the file was cut off; the readers of python-can may stop early in silence.

    The header of a BLF has its length, an ASC has a last line, and all logs in text end every line.
    """
    if path.suffix.lower() == ".blf":
        with readable(path, "a BLF log"), can.BLFReader(path) as reader:
            size = int(reader.file_size)
        if os.path.getsize(path) >= size:
            return
        expected, found = f"{size} bytes as its header says", str(os.path.getsize(path))
    else:
        with path.open("rb") as file:
            head = file.read(_READ_BYTES).lower()
            file.seek(max(0, os.path.getsize(path) - _READ_BYTES))
            tail = file.read().lower()
        last = tail.splitlines()[-1].decode("utf-8", "replace") if tail else ""
        has_no_end = b"begin triggerblock" in head and b"end triggerblock" not in tail
        if not has_no_end and (tail.endswith(b"\n") or "end triggerblock" in last):
            return
        expected = "a last line 'End TriggerBlock'" if has_no_end else "a complete last line"
        found = repr(last)
    raise DatasetError(
        f"{path}: expected {expected}, found {found}: the log is truncated. Copy or convert it "
        f"again, or leave it out."
    )
