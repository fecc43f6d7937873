"""Logs in MDF, versions 3 and 4, by asammdf (extra `logs`)."""

import gc
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from offline.logs.log import Channel, Log, foreign_file, require_columns
from rt_controller.contract.errors import DatasetError, MissingExtraError

SUFFIXES = (".mf4", ".mdf", ".dat")

_OF_GROUP = "@"


def read_mf4(path: Path, wanted: Sequence[str]) -> Log:
    """The wanted channels of an MDF file, each with the time of its own group.

    A name that several groups have is told apart by the group's number: "VehicleSpeed@3".

    Raises:
        MissingExtraError: asammdf is not installed.
        DatasetError: the file is damaged, or a channel is missing, in several groups, or holds no
            numbers.
    """
    if find_spec("asammdf") is None:
        raise MissingExtraError(
            f"{path}: MDF expects the extra 'logs', found no asammdf. Run: pip install -e "
            f'".[logs]"'
        )
    with _opened(path) as mdf:
        places = {name: tuple(where) for name, where in mdf.channels_db.items()}
        bare = [column.partition(_OF_GROUP)[0] for column in wanted]
        require_columns(path, bare, [name for name in places if name not in ("t", "time")])
        channels = tuple(_read_channel(path, mdf, column, places) for column in wanted)
    rows = max((len(channel.t_s) for channel in channels), default=0)
    return Log(path, channels, "row", rows)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The file, open; whatever asammdf makes of damaged bytes ends in one kind of error."""
    # It logs what it then raises.
    logger = logging.getLogger("asammdf")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        with _open(path) as mdf:
            yield mdf
    except DatasetError:
        raise
    except Exception as error:
        raise foreign_file(path, "an MDF file", error) from error
    finally:
        logger.setLevel(before)


def _open(path: Path) -> Any:
    """The file as asammdf sees it.

    A file that it fails to open also fails to be forgotten, with a traceback on the terminal; so
    that is let happen here and without a word.
    """
    from asammdf import MDF

    failure = ""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        return MDF(path)
    except Exception as error:
        failure = str(error) or type(error).__name__
    finally:
        gc.collect()
        sys.unraisablehook = hook
    raise foreign_file(path, "an MDF file", failure)


def _read_channel(
    path: Path, mdf: Any, column: str, places: dict[str, tuple[tuple[int, int], ...]]
) -> Channel:
    name, _, number = column.partition(_OF_GROUP)
    where = [place for place in places[name] if not number or number == str(place[0])]
    groups = ", ".join(f"{name}{_OF_GROUP}{group}" for group, _ in places[name])
    if len(where) != 1:
        raise DatasetError(
            f"{path}, column {column}: expected a channel of one group, found {len(where)}. Write "
            f"one of {groups} in the mapping."
        )
    group, index = where[0]
    signal = mdf.get(name, group=group, index=index)
    values = np.asarray(signal.samples)
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        raise DatasetError(
            f"{path}, column {column}: expected numbers, found {values.dtype} of shape "
            f"{values.shape}. Choose a channel that holds one number a sample."
        )
    return Channel(
        column,
        np.asarray(signal.timestamps, dtype=np.float64),
        values.astype(np.float64),
        np.arange(1, len(values) + 1, dtype=np.int64),
        signal.unit or None,
    )
