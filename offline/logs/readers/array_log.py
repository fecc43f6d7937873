"""Logs as arrays with names: npz archives of numpy, and MATLAB files up to version 7.2."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.logs.mapping_tables import TimeMapping
from offline.logs.readers.log import Log, readable
from offline.logs.readers.table import columns_to_read, to_log
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.files import DamagedArchiveError, read_arrays

_HDF5 = b"\x89HDF"
_HDF5_POSITIONS = (0, 512)
"""MATLAB writes 512 bytes of its own before the HDF5 file of its version 7.3"""


def read_npz(path: Path, wanted: Sequence[str], time: TimeMapping) -> Log:
    """The wanted arrays of an npz archive."""
    with readable(path, "an npz archive", (OSError, DamagedArchiveError)):
        arrays = read_arrays(path)
    return _to_log(path, arrays, wanted, time)


def read_mat(path: Path, wanted: Sequence[str], time: TimeMapping) -> Log:
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
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in variables.items():
        fields = value if isinstance(value, dict) else {}
        arrays |= {f"{name}.{field}": np.asarray(content) for field, content in fields.items()}
        if not fields and not name.startswith("__"):
            arrays[name] = np.asarray(value)
    return _to_log(path, arrays, wanted, time)


def _to_log(
    path: Path, arrays: Mapping[str, NDArray[Any]], wanted: Sequence[str], time: TimeMapping
) -> Log:
    columns = {}
    for column in columns_to_read(path, wanted, time, list(arrays)):
        array = arrays[column]
        vector = np.squeeze(array)
        if vector.ndim != 1 or vector.dtype.kind not in "fiub":
            raise DatasetError(
                f"{path}, column {column}: expected a vector of numbers, found {array.dtype} of "
                f"shape {array.shape}. Export each signal as a separate vector."
            )
        columns[column] = vector.astype(np.float64 if vector.dtype.kind == "f" else np.int64)
    lengths = {column: len(values) for column, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DatasetError(
            f"{path}: expected arrays of one length, found "
            f"{', '.join(f'{name} of {n}' for name, n in lengths.items())}. Export one row for "
            f"each instant."
        )
    frame = pd.DataFrame(columns)
    frame.index += 1
    return to_log(path, frame, wanted, time, "row", {})
