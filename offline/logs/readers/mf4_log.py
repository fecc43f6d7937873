"""Logs in MDF, versions 3 and 4, read by asammdf."""

import gc
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from offline.logs.readers.log import Log, Names, RowsOf, Series, find_headings, readable
from rt_controller.contract.errors import DatasetError, require_packages

_TIME_CHANNELS = ("t", "time")


def read_mf4(path: Path, wanted: Sequence[Names]) -> Log:
    """The wanted channels of an MDF file, each with the time of its channel group.

    A name that occurs in several groups needs the number of the group: "VehicleSpeed@3".
    """
    require_packages("logs", ("asammdf",), f"{path}: an MDF file")
    with _opened(path) as mdf:
        names = [name for name in mdf.channels_db if name not in _TIME_CHANNELS]
        channels = tuple(_read_channel(path, mdf, each, names) for each in wanted)
    return Log(path.name, path, channels, max(len(channel.t_s) for channel in channels))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The open file; every exception of asammdf for damaged bytes becomes a `DatasetError`."""
    from asammdf import MDF

    # asammdf logs what it raises. If opening fails, the destructor of the half-made object fails
    # too and would print a traceback: it is called here with that print switched off.
    logger, hook = logging.getLogger("asammdf"), sys.unraisablehook
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    failure = ""
    try:
        with MDF(path) as mdf:
            yield mdf
    except DatasetError:
        raise
    except Exception as error:
        failure = str(error) or type(error).__name__
        sys.unraisablehook = lambda _: None
    finally:
        logger.setLevel(level)
    if failure:
        gc.collect()
        sys.unraisablehook = hook
        with readable(path, "an MDF file"):
            raise OSError(failure)  # not the first one: its traceback holds the half-made object


def _read_channel(path: Path, mdf: Any, wanted: Names, texts: Sequence[str]) -> Series:
    """A channel with one of the wanted names, which may have the number of its group."""
    plain = [each.partition("@")[0] for each in wanted]
    (heading,) = find_headings(path, [plain], texts)
    column = wanted[plain.index(heading.name)]
    name, number = heading.text, column.partition("@")[2]
    places = mdf.channels_db[name]
    chosen = [place for place in places if number in ("", str(place[0]))]
    if len(chosen) != 1:
        raise DatasetError(
            f"{path}, column {column}: expected a channel of one group, found {len(chosen)}. Write "
            f"one of {', '.join(f'{name}@{group}' for group, _ in places)} in the mapping."
        )
    group, index = chosen[0]
    signal = mdf.get(name, group=group, index=index)
    values = np.asarray(signal.samples)
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        raise DatasetError(
            f"{path}, column {column}: expected numbers, found {values.dtype} of shape "
            f"{values.shape}. Choose a channel that has one number for each sample."
        )
    return Series(
        column,
        np.asarray(signal.timestamps, dtype=np.float64),
        values.astype(np.float64),
        np.arange(1, len(values) + 1),
        signal.unit or heading.unit or "",
        RowsOf(path, "row"),
    )
