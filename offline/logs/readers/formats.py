"""The formats of logs: one function each, in one table by the ending of the file."""

import logging
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.logs.readers.csv_log import OPENERS, read_csv
from offline.logs.readers.log import Log, LogColumn, Names, Request, find_headings
from rt_controller.contract.errors import DatasetError, RtControllerError, require_packages
from rt_controller.contract.files import read_arrays
from rt_controller.mapping.value_names import stands_for_no_value


def read_file(ask: Request) -> Log:
    """The wanted columns of one file, by its ending or its first bytes.

    Raises:
        DatasetError: the file is missing, damaged, truncated or of a version that cannot be read; a
            column is missing, ambiguous or has no numbers; time is missing, runs backwards or has
            another period than the mapping; a frame is shorter than its message.
        MissingExtraError: the package that reads such logs is not installed.
    """
    path = ask.path
    try:
        with path.open("rb") as file:
            head = file.read(8)
        suffix = path.suffix.lower()
        reader = READERS.get(suffix, read_csv)
        if head.startswith(b"\x93NUMPY"):  # data sets of openpilot have such files without ending
            reader = _read_npy
        elif suffix == ".dat" and not head.startswith((b"MDF", b"UnFinMF")):
            reader = read_csv
        if reader is not _read_can:
            ask.require_columns()
        return reader(ask)
    except RtControllerError:
        raise
    except Exception as error:  # the libraries raise many types, which they do not document
        reason = str(error) or type(error).__name__
        if isinstance(error, UnicodeError) or "unknown encoding" in reason:
            raise DatasetError(
                f"{path}: expected text in {ask.csv.encoding}, found other bytes ({reason}). Name "
                f'the encoding in the mapping: [csv] encoding = "latin-1".'
            ) from error
        raise DatasetError(
            f"{path}: expected a log in the format of its ending, found a truncated, damaged or "
            f"foreign file ({reason}). Export or copy it again, or leave it out."
        ) from error


def _read_npz(ask: Request) -> Log:
    return _arrays_to_log(ask, read_arrays(ask.path))


def _read_npy(ask: Request) -> Log:
    """The columns of one numpy array: its fields, or 1, 2, and so on."""
    array = np.load(ask.path, allow_pickle=False)
    if array.dtype.names:
        return _arrays_to_log(ask, {name: array[name] for name in array.dtype.names})
    table = array[:, None] if array.ndim == 1 else array
    if table.ndim != 2:
        raise DatasetError(
            f"{ask.path}: expected an array of one row for each instant, found the shape "
            f"{array.shape}. Export each signal as a separate vector."
        )
    return _arrays_to_log(ask, {str(k + 1): column for k, column in enumerate(table.T)})


def _read_mat(ask: Request) -> Log:
    """The variables of a MATLAB file; "run.vx" is the field vx of the struct run."""
    from scipy.io import loadmat

    try:
        variables = loadmat(ask.path, simplify_cells=True)
    except NotImplementedError as error:
        raise DatasetError(
            f"{ask.path}: expected a MATLAB file up to version 7.2, found version 7.3. Save it in "
            f"MATLAB with save(…, '-v7')."
        ) from error
    own = {name: value for name, value in variables.items() if not name.startswith("__")}
    return _arrays_to_log(ask, dict(_fields(own)))


def _fields(struct: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Every variable that is no struct, with the names of the structs around it."""
    for name, value in struct.items():
        if isinstance(value, dict):
            yield from _fields(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", np.asarray(value)


def _arrays_to_log(ask: Request, arrays: Mapping[str, NDArray[Any]]) -> Log:
    """The wanted vectors; numbers keep their type, so that large time stamps stay exact."""
    columns = ask.choose(list(arrays))
    vectors = {}
    for text in dict.fromkeys(each.text for each in columns):
        vector = np.squeeze(arrays[text])
        if vector.ndim != 1 or vector.dtype.kind not in "fiubM":
            raise DatasetError(
                f"{ask.path}, column {text}: expected a vector of numbers, found "
                f"{arrays[text].dtype} of shape {arrays[text].shape}. Export each signal as a "
                f"separate vector."
            )
        vectors[text] = vector if vector.dtype.kind in "fM" else vector.astype(np.int64)
    if len({len(vector) for vector in vectors.values()}) > 1:
        listed = ", ".join(f"{text} of {len(vector)}" for text, vector in vectors.items())
        raise DatasetError(
            f"{ask.path}: expected arrays of one length, found {listed}. Export one row for each "
            f"instant, or write `time` for the columns that have times of their own."
        )
    frame = pd.DataFrame(vectors)
    frame.index += 1
    return ask.to_log(frame, columns)


def _read_parquet(ask: Request) -> Log:
    """The columns of a Parquet file; a field's metadata may give its `unit`."""
    require_packages("logs", ("pyarrow",), f"{ask.path}: a Parquet file")
    from pyarrow import parquet, types

    columns = ask.choose(parquet.read_schema(ask.path).names)
    content = parquet.read_table(
        ask.path, columns=list(dict.fromkeys(each.text for each in columns))
    )
    numeric = (types.is_floating, types.is_integer, types.is_boolean, types.is_decimal)
    units = {}
    for field in content.schema:
        is_time = bool(ask.clock.column) and field.name == columns[0].text
        is_date = is_time and types.is_timestamp(field.type)
        if not is_date and not any(is_kind(field.type) for is_kind in numeric):
            raise DatasetError(
                f"{ask.path}, column {field.name}: expected numbers, found {field.type}. Export "
                f"the column as numbers."
            )
        units[field.name] = (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
    frame = content.to_pandas(ignore_metadata=True)
    frame.index += 1
    return ask.to_log(frame, columns, units)


_TIME_CHANNELS = ("t", "time")


def _read_mf4(ask: Request) -> Log:
    """The channels of an MDF file (versions 3 and 4), each with the time of its channel group.

    A name that occurs in several groups needs the number of the group: "VehicleSpeed@3".
    """
    require_packages("logs", ("asammdf",), f"{ask.path}: an MDF file")
    from asammdf import MDF
    from asammdf.blocks import mdf_v3, mdf_v4

    logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # it logs what it raises
    classes: tuple[Any, ...] = (mdf_v3.MDF3, mdf_v4.MDF4)
    for each in classes:  # if opening fails, the destructor of the half-made object fails too
        each.__del__ = lambda _: None
    with MDF(ask.path) as mdf:
        names = [name for name in mdf.channels_db if name not in _TIME_CHANNELS]
        channels = tuple(c for each in ask.wanted for c in _read_channel(ask, mdf, each, names))
    return Log(ask.path.name, channels, max(len(channel.t_s) for channel in channels))


def _read_channel(ask: Request, mdf: Any, wanted: Names, texts: list[str]) -> Iterator[LogColumn]:
    """The channel with one of the wanted names, which may have the number of its group."""
    plain = [each.partition("@")[0] for each in wanted]
    found = find_headings(ask.path, [plain], texts)
    if not found:
        return
    heading = found[0]
    column = wanted[plain.index(heading.name)]
    name, number = heading.text, column.partition("@")[2]
    places = mdf.channels_db[name]
    chosen = [place for place in places if number in ("", str(place[0]))]
    if len(chosen) != 1:
        raise DatasetError(
            f"{ask.path}, column {column}: expected a channel of one group, found {len(chosen)}. "
            f"Write one of {', '.join(f'{name}@{group}' for group, _ in places)} in the mapping."
        )
    signal = mdf.get(name, group=chosen[0][0], index=chosen[0][1], raw=True)
    place = f"{ask.path}, column {column}"
    values, missing = _numbers(signal.conversion, np.asarray(signal.samples))
    if values.ndim != 1 or values.dtype.kind not in "fiub":
        raise DatasetError(
            f"{place}: expected numbers, found {values.dtype} of shape {values.shape}. Choose a "
            f"channel that has one number for each sample."
        )
    is_known = ~np.isin(np.arange(len(values)), [k for own in missing.values() for k in own])
    listed = "; ".join(f"{len(own)} {text!r} in the file" for text, own in missing.items())
    unusable = f"{listed}: the car has no value then" if listed else ""
    if not is_known.any() and unusable:
        raise DatasetError(
            f"{place}: expected measurements, found none among {len(values)} samples: {unusable}. "
            f"Leave the file out."
        )
    t_s, rows = np.asarray(signal.timestamps, dtype=np.float64), np.arange(1, len(values) + 1)
    unit = signal.unit or heading.unit or ""
    numbers = values.astype(np.float64)[is_known]
    yield LogColumn(
        column, t_s[is_known], numbers, rows[is_known], unit, ask.path, unusable=unusable
    )


_TABLES = {
    (b"##CC", 7): ("val", "val"),
    (b"##CC", 8): ("lower", "upper"),
    (b"CC", 11): ("param_val", "param_val"),
    (b"CC", 12): ("lower", "upper"),
}
"""conversions of MDF 4 and 3 with texts of some raw values: first and last raw value of a text"""
_LINEAR_TEXT = re.compile(r'"?\s*([-+.\deE]+)\s*\*\s*\{X\}\s*([-+][.\deE+-]+)?\s*"?')


def _numbers(conversion: Any, raws: NDArray[Any]) -> tuple[NDArray[Any], dict[str, list[int]]]:
    """The numbers of raw values, and by text the samples whose text stands for no value.

    A raw value with another text has the number that it would have without the text.
    """
    if conversion is None:
        return raws, {}
    edges = _TABLES.get((conversion.id, conversion.conversion_type))
    if edges is None or raws.ndim != 1 or raws.dtype.kind not in "fiub":
        return np.asarray(conversion.convert(raws)), {}
    blocks: Mapping[str, Any] = conversion.referenced_blocks or {}
    missing: dict[str, list[int]] = defaultdict(list)
    is_named = np.zeros(len(raws), dtype=np.bool_)
    default: Any = blocks.get("default_addr")
    numbers, is_text = np.array(raws, dtype=np.float64), isinstance(default, bytes)
    if is_text and (linear := _LINEAR_TEXT.fullmatch(_decoded(default))):
        numbers, is_text = float(linear[1]) * numbers + float(linear[2] or 0.0), False
    elif default is not None and not is_text:
        numbers, inner = _numbers(default, raws)
        numbers = numbers.astype(np.float64)
        missing.update(inner)
    for i in count():
        low, high = (getattr(conversion, f"{edge}_{i}", None) for edge in edges)
        if low is None or high is None:
            break
        own = (raws >= low) & (raws <= high) & ~is_named
        is_named |= own
        text = blocks.get(f"text_{i}", getattr(conversion, f"text_{i}", b""))
        if isinstance(text, bytes):
            if stands_for_no_value(_decoded(text)):
                missing[_decoded(text)] += np.flatnonzero(own).tolist()
        elif text is not None and own.any():
            numbers[own], inner = _numbers(text, raws[own])
            for name, samples in inner.items():
                missing[name] += np.flatnonzero(own)[samples].tolist()
    if is_text and stands_for_no_value(_decoded(default)):
        missing[_decoded(default)] += np.flatnonzero(~is_named).tolist()
    return numbers, {text: samples for text, samples in missing.items() if samples}


def _decoded(text: bytes) -> str:
    plain = text.split(b"\0")[0].strip()
    try:
        return plain.decode("utf-8")
    except UnicodeDecodeError:
        return plain.decode("latin-1")  # of MDF 3


def _read_can(ask: Request) -> Log:
    # python-can and cantools are imported for such logs only.
    from offline.logs.readers.can_log import read_can

    return read_can(ask)


READERS: dict[str, Callable[[Request], Log]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt"), read_csv),
    ".npz": _read_npz,
    ".npy": _read_npy,
    ".mat": _read_mat,
    **dict.fromkeys((".parquet", ".pq"), _read_parquet),
    **dict.fromkeys((".mf4", ".mdf", ".dat"), _read_mf4),
    **dict.fromkeys((".blf", ".asc", ".log", ".trc"), _read_can),
}
_PACKED_CSV = [plain + packed for plain in (".csv", ".tsv", ".txt") for packed in OPENERS]
SUFFIXES = (*READERS, *_PACKED_CSV)
