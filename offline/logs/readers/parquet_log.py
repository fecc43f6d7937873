"""Logs in Parquet, read by pyarrow."""

from collections.abc import Sequence
from pathlib import Path

from offline.logs.readers.log import Log, Names, RowsOf, readable
from offline.logs.readers.table import columns_to_read, to_log
from rt_controller.contract.errors import DatasetError, require_packages
from rt_controller.mapping.tables import Clock


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
