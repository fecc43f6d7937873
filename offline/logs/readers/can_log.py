"""Logs of a CAN bus, read by python-can and decoded with a DBC by cantools.

The only module of `offline` that imports them: it reads files and opens no bus.
"""

import os
from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from typing import cast

import can
import cantools
import numpy as np
from cantools.database.can import Database

from offline.logs.readers.log import Log, Names, Request, Series
from rt_controller.contract.errors import ConfigError, DatasetError, RtControllerError
from rt_controller.mapping.car_file import Source, find_source, load_dbc
from rt_controller.mapping.log_damage import explain_damage

_READ_BYTES = 4096
"""from the beginning and from the end of a log in text"""


def read_can(ask: Request) -> Log:
    """The wanted signals of a CAN log, each with the time stamps of its frames.

    A column is a signal's name, or "Message.Signal" if several messages have a signal of that name.
    """
    path, settings = ask.path, ask.can
    if settings is None:
        raise DatasetError(
            f"{path}: expected a DBC to decode the log with, found none in the mapping. Write "
            f'[can] dbc = "car.dbc".'
        )
    database = load_dbc(settings.dbc)
    sources = dict(_find_source(path, database, names) for names in ask.wanted)
    messages = {
        (m.frame_id, m.is_extended_frame): (column, m) for column, (m, _) in sources.items()
    }
    _require_complete(path)
    samples = defaultdict(list)  # frame number, time in s and value, by message and signal
    count = 0
    try:
        with can.LogReader(path) as reader:
            for count, frame in enumerate(reader, start=1):
                found = messages.get((frame.arbitration_id, frame.is_extended_id))
                is_elsewhere = settings.channel is not None and (
                    str(frame.channel) != str(settings.channel)
                )
                if not found or is_elsewhere or frame.is_error_frame or frame.is_remote_frame:
                    continue
                column, message = found
                try:
                    decoded = message.decode_simple(bytes(frame.data), decode_choices=False)
                except (cantools.Error, ValueError) as error:
                    raise DatasetError(
                        f"{path}, column {column}, frame {count}: expected {message.length} bytes "
                        f"of {message.name}, found {len(frame.data)} that do not decode ({error}). "
                        f"The log may be truncated, or the DBC is of another car."
                    ) from error
                for name, value in decoded.items():
                    sample = (count, frame.timestamp, float(cast(float, value)))
                    samples[message.name, name].append(sample)
    except RtControllerError:
        raise
    except Exception as error:  # each reader raises its own types
        raise DatasetError(
            f"{explain_damage(path, count)}. Export or copy it again, or leave it out."
        ) from error
    channels = []
    for column, (message, signal) in sources.items():
        if (message.name, signal.name) not in samples:
            where = "" if settings.channel is None else f" on channel {settings.channel}"
            raise DatasetError(
                f"{path}, column {column}: expected frames of {message.name} "
                f"({message.frame_id:#x}), found none among {count} frames{where}. Check the DBC "
                f"and [can] channel, or leave the file out."
            )
        rows, t_s, values = map(np.array, zip(*samples[message.name, signal.name], strict=True))
        channels.append(Series(column, t_s, values, rows, signal.unit or "", path, "frame"))
    return Log(path.name, tuple(channels), count)


def _find_source(path: Path, database: Database, names: Names) -> tuple[str, Source]:
    """The first of the names that the DBC has, and its signal."""
    for name in names[:-1]:
        with suppress(ConfigError):
            return name, find_source(str(path), database, name)
    return names[-1], find_source(str(path), database, names[-1])


def _require_complete(path: Path) -> None:
    """Return unless the file was cut off; the readers of python-can may stop early in silence.

    The header of a BLF has its length, an ASC has a last line, and all logs in text end every line.
    """
    if path.suffix.lower() == ".blf":
        with can.BLFReader(path) as reader:
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
