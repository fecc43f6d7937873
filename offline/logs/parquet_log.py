"""Logs in Parquet, by pyarrow (extra `logs`)."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offline.logs.log import Log, foreign_file
from offline.logs.mapping import TimeMapping
from offline.logs.table import Table, require_table_columns, stamp
from rt_controller.contract.errors import DatasetError, MissingExtraError

SUFFIXES = (".parquet", ".pq")

_NS_PER_S = 1e9


def read_parquet(path: Path, wanted: Sequence[str], time: TimeMapping) -> Log:
    """The wanted columns of a Parquet file.

    Raises:
        MissingExtraError: pyarrow is not installed.
        DatasetError: the file is damaged, a column is missing or holds no numbers.
    """
    if find_spec("pyarrow") is None:
        raise MissingExtraError(
            f"{path}: Parquet expects the extra 'logs', found no pyarrow. Run: pip install -e "
            f'".[logs]"'
        )
    import pyarrow as pa
    from pyarrow import parquet

    try:
        names = list(parquet.read_schema(path).names)
        needed = require_table_columns(path, wanted, time, names)
        content = parquet.read_table(path, columns=needed)
    except (OSError, pa.ArrowException) as error:
        raise foreign_file(path, "a Parquet file", error) from error
    columns = {name: _to_column(path, name, content.column(name)) for name in needed}
    units = {
        field.name: field.metadata[b"unit"].decode("utf-8", "replace")
        for field in content.schema
        if field.metadata and b"unit" in field.metadata
    }
    rows = np.arange(1, content.num_rows + 1, dtype=np.int64)
    return stamp(Table(path, columns, rows, "row", units), wanted, time)


def _to_column(path: Path, name: str, column: Any) -> NDArray[np.float64]:
    import pyarrow as pa

    kind = column.type
    if pa.types.is_timestamp(kind):
        stamps = column.cast(pa.timestamp("ns")).cast(pa.int64())
        # Float cannot hold nanoseconds since 1970; the first stamp is taken off before.
        counted = np.asarray(stamps.combine_chunks().drop_null().to_numpy(zero_copy_only=False))
        if len(counted) == len(column):
            return np.asarray((counted - counted[:1]) / _NS_PER_S, dtype=np.float64)
        return np.asarray(stamps.cast(pa.float64()).to_numpy()) / _NS_PER_S
    if pa.types.is_decimal(kind) or pa.types.is_boolean(kind):
        kind, column = pa.float64(), column.cast(pa.float64())
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        raise DatasetError(
            f"{path}, column {name}: expected numbers, found {kind}. Export the column as numbers."
        )
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)
