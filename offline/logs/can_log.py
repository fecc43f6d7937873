"""Logs of a CAN bus, by python-can, decoded with a DBC by cantools.

The one place in this package that knows CAN: it reads files, it opens no bus.
"""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import can
import cantools
import numpy as np
from cantools.database.can import Database

from offline.logs.log import Channel, Log, foreign_file, require_columns
from offline.logs.mapping import CanSettings
from rt_controller.contract.errors import DatasetError

_READ_BYTES = 4096
"""from the beginning and the end of a log in text"""


class _Place(NamedTuple):
    """Where a column is found on the bus."""

    column: str
    frame_id: int
    is_extended: bool
    message: str
    signal: str
    unit: str | None


def read_can(path: Path, wanted: Sequence[str], settings: CanSettings | None) -> Log:
    """The wanted signals of a CAN log, each stamped with its frames.

    A column is a signal's name, or "Message.Signal" where several messages have one of that name.

    Raises:
        DatasetError: the log or the DBC is missing, damaged or truncated, a signal is unknown or
            never on the bus, or a frame is shorter than its message.
    """
    if settings is None:
        raise DatasetError(
            f"{path}: expected a DBC to decode the log with, found none in the mapping. Write "
            f'[can] dbc = "car.dbc".'
        )
    database = _load_dbc(settings.dbc)
    places = _find(path, database, wanted)
    _require_whole(path)
    frames, samples = _decode(path, database, places, settings.channel)
    channels = []
    for place in places:
        stamps = samples[place.column]
        if not stamps:
            where = "" if settings.channel is None else f" on channel {settings.channel}"
            raise DatasetError(
                f"{path}, column {place.column}: expected frames of {place.message} "
                f"({place.frame_id:#x}), found none among {frames} frames{where}. Check the DBC "
                f"and [can] channel, or leave the file out."
            )
        columns = np.array(stamps, dtype=np.float64)
        channels.append(
            Channel(
                place.column,
                columns[:, 1].copy(),
                columns[:, 2].copy(),
                columns[:, 0].astype(np.int64),
                place.unit,
            )
        )
    return Log(path, tuple(channels), "frame", frames)


def _load_dbc(path: Path) -> Database:
    try:
        database = cantools.database.load_file(path)
    except OSError as error:
        raise DatasetError(
            f"{path}: expected a DBC, found nothing readable ({error.strerror}). Correct [can] dbc."
        ) from error
    except (cantools.Error, ValueError) as error:
        raise DatasetError(
            f"{path}: expected a DBC, found a file that cannot be parsed ({error}). Correct [can] "
            f"dbc."
        ) from error
    if not isinstance(database, Database):
        raise DatasetError(
            f"{path}: expected a database of CAN messages, found one of another kind. Correct "
            f"[can] dbc."
        )
    return database


def _find(path: Path, database: Database, wanted: Sequence[str]) -> list[_Place]:
    known = [
        _Place(
            f"{message.name}.{signal.name}",
            message.frame_id,
            message.is_extended_frame,
            message.name,
            signal.name,
            signal.unit or None,
        )
        for message in database.messages
        for signal in message.signals
    ]
    require_columns(path, wanted, [name for p in known for name in (p.column, p.signal)])
    places = []
    for column in wanted:
        fits = [place for place in known if column in (place.column, place.signal)]
        if len(fits) > 1:
            raise DatasetError(
                f"{path}, column {column}: expected a signal of one message, found it in "
                f"{len(fits)}. Write one of {', '.join(place.column for place in fits)} in the "
                f"mapping."
            )
        places.append(fits[0]._replace(column=column))
    return places


def _decode(
    path: Path, database: Database, places: Sequence[_Place], channel: int | str | None
) -> tuple[int, dict[str, list[tuple[int, float, float]]]]:
    """Number of frames, and by column (frame, time in s, value)."""
    of_frame: dict[tuple[int, bool], list[_Place]] = {}
    for place in places:
        of_frame.setdefault((place.frame_id, place.is_extended), []).append(place)
    samples: dict[str, list[tuple[int, float, float]]] = {place.column: [] for place in places}
    count = 0
    for count, frame in enumerate(_frames(path), start=1):
        here = of_frame.get((frame.arbitration_id, frame.is_extended_id))
        is_elsewhere = channel is not None and str(frame.channel) != str(channel)
        if here is None or is_elsewhere or frame.is_error_frame or frame.is_remote_frame:
            continue
        message = database.get_message_by_name(here[0].message)
        try:
            decoded = message.decode_simple(bytes(frame.data), decode_choices=False)
        except (cantools.Error, ValueError) as error:
            raise DatasetError(
                f"{path}, column {here[0].column}, frame {count}: expected {message.length} bytes "
                f"of {message.name}, found {len(frame.data)} that do not decode ({error}). The "
                f"log may be truncated, or the DBC is another car's."
            ) from error
        for place in here:
            # A multiplexed signal is not in every frame of its message.
            if place.signal in decoded:
                value = float(cast(float, decoded[place.signal]))
                samples[place.column].append((count, frame.timestamp, value))
    return count, samples


def _frames(path: Path) -> Iterator[can.Message]:
    """The frames of the log; whatever python-can makes of damaged bytes ends in one error."""
    try:
        with can.LogReader(path) as reader:
            yield from reader
    except (GeneratorExit, DatasetError):
        raise
    except Exception as error:
        raise foreign_file(path, "a CAN log", error) from error


def _require_whole(path: Path) -> None:
    """Return unless the file ends before it should, where a reader may simply stop early.

    The header of a BLF says how long it is, an ASC has a last line, and every writer of text ends
    each line.
    """
    if path.suffix.lower() == ".blf":
        _require_whole_blf(path)
        return
    with path.open("rb") as file:
        head = file.read(_READ_BYTES).lower()
        file.seek(max(0, os.path.getsize(path) - _READ_BYTES))
        tail = file.read().lower()
    last = tail.splitlines()[-1].decode("utf-8", "replace") if tail else ""
    is_open = b"begin triggerblock" in head and b"end triggerblock" not in tail
    if is_open or not (tail.endswith(b"\n") or "end triggerblock" in last):
        expected = "a last line 'End TriggerBlock'" if is_open else "a last line that is whole"
        raise DatasetError(
            f"{path}: expected {expected}, found {last!r}: the log is truncated. Copy or convert "
            f"it again, or leave it out."
        )


def _require_whole_blf(path: Path) -> None:
    try:
        with can.BLFReader(path) as reader:
            expected = int(reader.file_size)
    except Exception as error:
        raise foreign_file(path, "a BLF log", error) from error
    found = os.path.getsize(path)
    if found < expected:
        raise DatasetError(
            f"{path}: expected {expected} bytes as its header says, found {found}: the log is "
            f"truncated. Copy or convert it again, or leave it out."
        )
