"""Logs of a CAN bus, decoded with a DBC.

The only module of `offline` that imports python-can and cantools: it reads files and opens no bus.
"""

from collections.abc import Iterator
from math import isnan

import numpy as np

from offline.logs.readers.log import Log, LogColumn, Request
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.can_log import LoggedFrame, Sampled, read_frames, read_samples
from rt_controller.mapping.car_file import load_dbc
from rt_controller.mapping.measurement import ALLOWED_UNUSABLE_SHARE
from rt_controller.mapping.signal_frames import SignalReader

_REMEDY = "Export or copy it again, or leave it out."


def read_can(ask: Request) -> Log:
    """The wanted signals of a CAN log, each with the time stamps of its frames.

    A column is a signal's name, or "Message.Signal" if several messages have a signal of that name.
    What is no measurement of it is left out, as `rt-controller signals check` and the gateway do.
    """
    path, settings = ask.path, ask.can
    if settings is None:
        raise DatasetError(
            f"{path}: expected a DBC to decode the log with, found none in the mapping. Write "
            f'[can] dbc = "car.dbc".'
        )
    reader = SignalReader(ask.slots, ask.messages, load_dbc(settings.dbc), str(path))
    count = 0

    def counted() -> Iterator[LoggedFrame]:
        nonlocal count
        for each in read_frames(path, _REMEDY):
            count = each.number
            yield each

    tracks = read_samples(counted(), reader, str(path), settings.channel)
    channels = tuple(_column(ask, reader, name, track) for name, track in tracks.items())
    return Log(path.name, channels, count)


def _column(ask: Request, reader: SignalReader, name: str, track: list[Sampled]) -> LogColumn:
    measured, column = reader.measurements[name], reader.measurements[name].slot.column.column
    place = f"{ask.path}, column {column}"
    problem, remedy = reader.objection(name)
    if problem:
        raise DatasetError(f"{place}: expected samples, found {problem}. {remedy}.")
    usable = [each for each in track if not isnan(each.number)]
    implausible = measured.unusable[measured.implausible]
    if not usable or implausible > ALLOWED_UNUSABLE_SHARE * len(track):
        raise DatasetError(
            f"{place}: expected measurements, found {len(track) - len(usable)} of {len(track)} "
            f"samples that are none: {measured.explain()}."
        )
    rows, t_s, values = map(np.array, zip(*usable, strict=True))
    unusable = measured.explain() if measured.unusable else ""
    unit = measured.signal.unit or ""
    return LogColumn(column, t_s, values, rows, unit, ask.path, "frame", unusable)
