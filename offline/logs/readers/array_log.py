"""Logs as arrays: npz and npy of numpy, MATLAB files up to version 7.2, and Parquet."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.logs.readers.log import Log, Names, RowsOf, columns_to_read, readable, to_log
from rt_controller.contract.errors import DatasetError, require_packages
from rt_controller.contract.files import DamagedArchiveError, read_arrays
from rt_controller.mapping.tables import Clock

_HDF5 = b"\x89HDF"
_HDF5_POSITIONS = (0, 512)
"""MATLAB writes 512 bytes of its own before the HDF5 file of its version 7.3"""


def read_npz(path: Path, wanted: Sequence[Names], time: Clock) -> Log:
    """The wanted arrays of an npz archive."""
    with readable(path, "an npz archive", (OSError, DamagedArchiveError)):
        arrays = read_arrays(path)
    return _to_log(path, arrays, wanted, time)


def read_npy(path: Path, wanted: Sequence[Names], time: Clock) -> Log:
    """The wanted columns of one numpy array: its fields, or 1, 2, and so on."""
    with readable(path, "a numpy array"):
        array = np.load(path, allow_pickle=False)
    if array.dtype.names:
        columns = {name: array[name] for name in array.dtype.names}
    else:
        table = array[:, None] if array.ndim == 1 else array
        if table.ndim != 2:
            raise DatasetError(
                f"{path}: expected an array of one row for each instant, found the shape "
                f"{array.shape}. Export each signal as a separate vector."
            )
        columns = {str(k + 1): column for k, column in enumerate(table.T)}
    return _to_log(path, columns, wanted, time)


def read_mat(path: Path, wanted: Sequence[Names], time: Clock) -> Log:
    """The wanted variables of a MATLAB file; "run.vx" is the field vx of the struct run."""
    from scipy.io import loadmat

    with readable(path, "a MATLAB file"):  # scipy raises many types, which it does not document
        with path.open("rb") as file:
            head = file.read(_HDF5_POSITIONS[-1] + len(_HDF5))
        if any(head[begin:].startswith(_HDF5) for begin in _HDF5_POSITIONS):
            raise DatasetError(
                f"{path}: expected a MATLAB file up to version 7.2, found version 7.3. Save it in "
                f"MATLAB with save(…, '-v7')."
            )
        variables = loadmat(path, simplify_cells=True)
    own = {name: value for name, value in variables.items() if not name.startswith("__")}
    return _to_log(path, dict(_fields(own)), wanted, time)


def _fields(struct: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    """Every variable that is no struct, with the names of the structs around it."""
    for name, value in struct.items():
        if isinstance(value, dict):
            yield from _fields(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", np.asarray(value)


def _to_log(
    path: Path, arrays: Mapping[str, NDArray[Any]], wanted: Sequence[Names], time: Clock
) -> Log:
    columns = columns_to_read(path, wanted, time, list(arrays))
    vectors = {text: _vector(path, text, arrays[text]) for text in columns.texts}
    lengths = {text: len(values) for text, values in vectors.items()}
    if len(set(lengths.values())) > 1:
        raise DatasetError(
            f"{path}: expected arrays of one length, found "
            f"{', '.join(f'{name} of {n}' for name, n in lengths.items())}. Export one row for "
            f"each instant, or write `time` for the columns that have times of their own."
        )
    frame = pd.DataFrame(vectors)
    frame.index += 1
    return to_log(RowsOf(path, "row"), frame, columns, time)


def _vector(path: Path, text: str, array: NDArray[Any]) -> NDArray[Any]:
    """The array as a vector; numbers keep their type, so that large stamps stay exact."""
    vector = np.squeeze(array)
    if vector.ndim != 1 or vector.dtype.kind not in "fiubM":
        raise DatasetError(
            f"{path}, column {text}: expected a vector of numbers, found {array.dtype} of shape "
            f"{array.shape}. Export each signal as a separate vector."
        )
    return vector if vector.dtype.kind in "fM" else vector.astype(np.int64)


def read_parquet(path: Path, wanted: Sequence[Names], time: Clock) -> Log:
    """The wanted columns of a Parquet file; a field's metadata may give its `unit`."""
    require_packages("logs", ("pyarrow",), f"{path}: a Parquet file")
    import pyarrow as pa
    from pyarrow import parquet, types

    with readable(path, "a Parquet file", (OSError, pa.ArrowException)):
        columns = columns_to_read(path, wanted, time, parquet.read_schema(path).names)
        content = parquet.read_table(path, columns=columns.texts)
    numeric = (types.is_floating, types.is_integer, types.is_boolean, types.is_decimal)
    units = {}
    for field in content.schema:
        is_stamp = columns.time is not None and field.name == columns.time.text
        is_date = is_stamp and types.is_timestamp(field.type)
        if not is_date and not any(is_kind(field.type) for is_kind in numeric):
            raise DatasetError(
                f"{path}, column {field.name}: expected numbers, found {field.type}. Export the "
                f"column as numbers."
            )
        unit = (field.metadata or {}).get(b"unit")
        if unit is not None:
            units[field.name] = unit.decode("utf-8", "replace")
    frame = content.to_pandas(ignore_metadata=True)
    frame.index += 1
    return to_log(RowsOf(path, "row"), frame, columns, time, units.get)
