"""Logs as arrays by name: npz archives of numpy, and MATLAB files up to version 7.2."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offline.logs.log import Log, foreign_file
from offline.logs.mapping import TimeMapping
from offline.logs.table import Table, require_table_columns, stamp
from rt_controller.contract.archive import DamagedArchiveError, read_arrays
from rt_controller.contract.errors import DatasetError

NPZ_SUFFIXES = (".npz",)
MAT_SUFFIXES = (".mat",)

_HDF5 = b"\x89HDF"
_HDF5_IN_MAT = 512
"""bytes that MATLAB puts before the HDF5 file in its version 7.3"""


def read_npz(path: Path, wanted: Sequence[str], time: TimeMapping) -> Log:
    """The wanted arrays of an npz archive.

    Raises:
        DatasetError: the archive is truncated or altered, or an array is missing or of another
            shape.
    """
    try:
        arrays = read_arrays(path)
    except (OSError, DamagedArchiveError) as error:
        raise foreign_file(path, "an npz archive", error) from error
    return _to_log(path, arrays, wanted, time)


def read_mat(path: Path, wanted: Sequence[str], time: TimeMapping) -> Log:
    """The wanted variables of a MATLAB file; "run.vx" is the field vx of the struct run.

    Raises:
        DatasetError: the file is damaged or of version 7.3, or a variable is missing.
    """
    from scipy.io import loadmat

    try:
        with path.open("rb") as file:
            head = file.read(_HDF5_IN_MAT + len(_HDF5))
        if _HDF5 in (head[: len(_HDF5)], head[_HDF5_IN_MAT:]):
            raise DatasetError(
                f"{path}: expected a MATLAB file up to version 7.2, found version 7.3. Save it "
                f"in MATLAB with save(…, '-v7')."
            )
        variables = loadmat(path, squeeze_me=True)
    except DatasetError:
        raise
    # scipy answers a damaged file with a dozen types, few of them promised.
    except Exception as error:
        raise foreign_file(path, "a MATLAB file", error) from error
    return _to_log(path, _flatten(variables), wanted, time)


def _flatten(variables: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    flat: dict[str, NDArray[Any]] = {}
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        array = np.asarray(value)
        if array.dtype.names and array.ndim == 0:
            fields = array.item()
            for field, content in zip(array.dtype.names, fields, strict=True):
                flat[f"{name}.{field}"] = np.asarray(content)
        else:
            flat[name] = array
    return flat


def _to_log(
    path: Path, arrays: Mapping[str, NDArray[Any]], wanted: Sequence[str], time: TimeMapping
) -> Log:
    needed = require_table_columns(path, wanted, time, list(arrays))
    columns = {column: _to_column(path, column, arrays[column]) for column in needed}
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DatasetError(
            f"{path}: expected arrays of one length, found "
            f"{', '.join(f'{name} of {n}' for name, n in lengths.items())}. Export one row for "
            f"each instant."
        )
    rows = np.arange(1, next(iter(lengths.values())) + 1, dtype=np.int64)
    return stamp(Table(path, columns, rows, "row", {}), wanted, time)


def _to_column(path: Path, column: str, array: NDArray[Any]) -> NDArray[np.float64]:
    squeezed = np.squeeze(array)
    if squeezed.ndim != 1 or squeezed.dtype.kind not in "fiub":
        raise DatasetError(
            f"{path}, column {column}: expected a vector of numbers, found {array.dtype} of shape "
            f"{array.shape}. Export each signal as a vector of its own."
        )
    return squeezed.astype(np.float64)
