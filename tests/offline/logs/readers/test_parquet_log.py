"""Parquet files are read with units from the metadata."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from offline.logs.mapping import TimeMapping
from offline.logs.readers.array_log import read_parquet
from rt_controller.contract.errors import DatasetError

STAMPED = TimeMapping(column="t")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.parquet"


def test_nulls_are_missing_numbers(path):
    parquet.write_table(pa.table({"t": [0.0, 0.1, 0.2], "v": [1, None, 3], "o": [0, 0, 0]}), path)
    log = read_parquet(path, (("v",),), STAMPED)
    np.testing.assert_equal(log.channel("v").values, [1.0, np.nan, 3.0])
    assert log.channel("v").unit == ""


def test_a_unit_in_the_metadata_is_the_unit_of_the_file(path):
    fields = [pa.field("t", pa.float64()), pa.field("v", pa.float32(), metadata={"unit": "km/h"})]
    parquet.write_table(pa.table([[0.0, 1.0], [3.0, 4.0]], schema=pa.schema(fields)), path)
    assert read_parquet(path, (("v",),), STAMPED).channel("v").unit == "km/h"


def test_time_stamps_are_exact_to_the_nanosecond(path):
    stamps = pa.array([1_692_117_187_463_808_000 + k * 25_000_123 for k in range(3)])
    parquet.write_table(pa.table({"t": stamps.cast(pa.timestamp("ns")), "v": [1, 2, 3]}), path)
    log = read_parquet(path, (("v",),), TimeMapping(column="t", unit="iso8601"))
    assert log.channel("v").t_s == pytest.approx([0.0, 0.025000123, 0.050000246], abs=1e-12)


def test_a_column_of_texts_is_refused(path):
    parquet.write_table(pa.table({"t": [0.0, 1.0], "v": ["a", "b"]}), path)
    with pytest.raises(DatasetError, match=r"a\.parquet, column v: expected numbers, found string"):
        read_parquet(path, (("v",),), STAMPED)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.98])
def test_a_truncated_file_is_refused(path, share):
    parquet.write_table(pa.table({"t": np.arange(1000.0), "v": np.arange(1000.0)}), path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DatasetError, match=r"a\.parquet.*truncated"):
        read_parquet(path, (("v",),), STAMPED)


def test_a_missing_column_is_refused_with_similar_ones(path):
    parquet.write_table(pa.table({"t": [0.0, 1.0], "Speed": [1.0, 2.0]}), path)
    with pytest.raises(DatasetError, match="Did you mean Speed"):
        read_parquet(path, (("speed",),), STAMPED)


def test_nanoseconds_since_1970_keep_their_precision(path):
    stamps = [1_692_117_187_463_808_000 + k * 25_000_123 for k in range(3)]
    parquet.write_table(pa.table({"t": stamps, "v": [1, 2, 3]}), path)
    log = read_parquet(path, (("v",),), TimeMapping(column="t", unit="ns"))
    assert log.channel("v").t_s == pytest.approx([0.0, 0.025000123, 0.050000246], abs=1e-12)
