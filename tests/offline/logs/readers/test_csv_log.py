"""CSV files in the formats of common tools are read, or refused with file, column and line."""

import gzip
import re

import numpy as np
import pytest
from made_logs import write_csv

from offline.logs.mapping import CsvSettings, TimeMapping
from offline.logs.readers.csv_log import read_csv
from rt_controller.contract.errors import DatasetError

STAMPED = TimeMapping(column="t")


def read(path, wanted=("v",), time=STAMPED, **style):
    return read_csv(path, [(name,) for name in wanted], time, CsvSettings(**style))


def values_of(text, tmp_path, time=STAMPED, **style):
    path = tmp_path / "a.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    channel = read(path, time=time, **style).channel("v")
    return channel.t_s.tolist(), channel.values.tolist()


@pytest.mark.parametrize(
    "text",
    [
        "t,v\n1.0,2.5\n1.5,3.5\n",
        "t;v\n1,0;2,5\n1,5;3,5\n",
        "v\tt\n2.5\t1.0\n3.5\t1.5\n",
        "t   v\n1.0 2.5\n 1.5    3.5\n",
        "t;v\n1,0;2,5;\n1,5;3,5;\n",
        "# t,v\n1.0,2.5\n1.5,3.5\n",
        "% made by a tool\n%\n% t v\n1.0 2.5\n1.5 3.5\n",
        "# made by a tool\nt,v\n1.0,2.5\n1.5,3.5\n",
        "\ufefft , other, v\r\n1.0,7,2.5\r\n\r\n1.5,8,3.5\r\n",
        't,"v"\n"1.0","2.5"\n"1.5","3.5"\n',
    ],
)
def test_delimiters_and_decimals_are_detected(text, tmp_path):
    assert values_of(text, tmp_path) == ([0.0, 0.5], [2.5, 3.5])


def test_the_delimiter_can_be_set_and_a_wrong_one_is_refused(tmp_path):
    assert values_of("t v\n0 1\n1 2\n", tmp_path, delimiter=" ")[1] == [1.0, 2.0]
    with pytest.raises(DatasetError, match=r"\[csv\] delimiter = ','"):
        values_of("t,v\n0,1\n1,2\n", tmp_path, delimiter=";")


def test_columns_can_have_numbers_as_names(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1,2\n0.0,5\n0.1,6\n")
    assert read(path, ("2",), TimeMapping(column="1")).channel("2").values.tolist() == [5.0, 6.0]


def test_a_unit_behind_the_name_is_not_part_of_it(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('# t(ms),v [km/h],"w, deg/s",gear (front)\n0,36,1,3\n500,72,2,4\n')
    log = read(path, ("v", "w", "gear (front)"))
    assert [channel.unit for channel in log.channels] == ["km/h", "deg/s", ""]
    assert log.channel("w").t_s.tolist() == [0.0, 0.5]
    with pytest.raises(DatasetError, match=r"column t: expected a time in s, .*'t\(ms\)'"):
        read(path, time=TimeMapping(column="t", unit="s"))


def test_a_unit_at_the_end_of_a_name_is_that_of_the_numbers(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t_ms,v_kmh,Yaw_degps,a_n\n0,36,1,3\n500,72,2,4\n")
    log = read(path, ("v_kmh", "Yaw_degps", "a_n"), TimeMapping(column="t_ms"))
    assert [channel.unit for channel in log.channels] == ["km/h", "deg/s", ""]
    assert log.channel("v_kmh").t_s.tolist() == [0.0, 0.5]


def test_a_column_may_have_other_names(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("stamp,speed\n0,5\n0.1,6\n")
    style, time = CsvSettings(), TimeMapping(column="t", other_names=("time", "stamp"))
    log = read_csv(path, [("v", "speed")], time, style)
    assert log.channel("v", "speed").values.tolist() == [5.0, 6.0]
    with pytest.raises(DatasetError, match="expected a column 'v' or 'velocity', found none"):
        read_csv(path, [("v", "velocity")], time, style)


def test_columns_without_header_are_named_by_their_number(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("# a comment\n0.0 5\n0.1 6\n")
    log = read(path, ("2",), TimeMapping(column="1"), header_line=0)
    assert log.channel("2").values.tolist() == [5.0, 6.0]
    assert log.channel("2").row.tolist() == [2, 3]


def test_rows_with_the_time_of_the_row_before_can_be_left_out(tmp_path):
    time = TimeMapping(column="t", repeated="skip")
    assert values_of("t,v\n0,1\n0,2\n1,3\n", tmp_path, time) == ([0.0, 1.0], [1.0, 3.0])
    with pytest.raises(DatasetError, match="line 4: expected time to increase, found 0 after 1"):
        values_of("t,v\n0,1\n1,2\n0,3\n", tmp_path, time)


def test_header_and_units_can_be_in_any_line(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Logger 7\nt,v\ns,km/h\n0,36\n1,72\n")
    channel = read(path, header_line=2, units_line=3).channel("v")
    assert channel.unit == "km/h"
    assert channel.row.tolist() == [4, 5]


def test_dates_are_converted_to_time(tmp_path):
    text = "t,v\n2024-05-01T10:00:00.000,1\n2024-05-01T10:00:00.025,2\n"
    t_s, _ = values_of(text, tmp_path, TimeMapping(column="t", unit="iso8601"))
    assert t_s == pytest.approx([0.0, 0.025], abs=1e-6)


def test_times_of_the_day_are_converted_to_time(tmp_path):
    text = "t;v\n10:00:59,990;1\n10:01:00,015;2\n"
    t_s, _ = values_of(text, tmp_path, TimeMapping(column="t", unit="hh:mm:ss"))
    assert t_s == pytest.approx([0.0, 0.025], abs=1e-9)
    with pytest.raises(DatasetError, match=r"line 2: expected a time such as 10:00:00\.025"):
        values_of("t,v\nten,1\n", tmp_path, TimeMapping(column="t", unit="hh:mm:ss"))


def test_stamps_since_1970_keep_their_microseconds(tmp_path):
    text = "t,v\n1692117187463808,1\n1692117187503809,2\n"
    t_s, _ = values_of(text, tmp_path, TimeMapping(column="t", unit="us"))
    assert t_s[1] == pytest.approx(0.040001, abs=1e-9)


def test_rows_without_time_are_one_period_apart(tmp_path):
    t_s, _ = values_of("v\n1\n2\n3\n", tmp_path, TimeMapping(period_s=0.01))
    assert t_s == pytest.approx([0.0, 0.01, 0.02])


def test_an_empty_cell_is_a_missing_number(tmp_path):
    _, values = values_of("t,v\n0,1\n1,\n2,NaN\n", tmp_path)
    assert values[0] == 1.0
    assert np.isnan(values[1:]).all()


@pytest.mark.parametrize("word", ["#N/A", "1.#QNAN", "---", "NaN"])
def test_words_for_no_number_are_missing_numbers(word, tmp_path):
    assert np.isnan(values_of(f"t,v\n0,1\n1,{word}\n", tmp_path)[1][1])


def test_utf_16_is_recognised_by_its_first_bytes(tmp_path):
    assert values_of("t\tv\n0\t1\n1\t2\n".encode("utf-16"), tmp_path)[1] == [1.0, 2.0]


def test_compressed_files_are_read(tmp_path):
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"t,v\n0,1\n1,2\n"))
    assert read(path).channel("v").values.tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,v\n0,1\n1,fast\n", "column v, line 3: expected a number, found 'fast'"),
        ("t,v\n0,1\n1,2\n2\n", "line 4: expected 2 cells as in the header, found 1"),
        ("t,v\n0,1\n2,2\n1,3\n", "column t, line 4: expected time to increase, found 1 after 2"),
        ("t,v\n0,1\n0,2\n", "column t, line 3: expected time to increase"),
        ("t,v\n0,1\n,2\n", "column t, line 3: expected a time, found none"),
        ("t,v\n0,1\n", "at least two rows"),
        ("", "a header in line 1"),
        ("t,Veh\n0,1\n1,2\n", "expected a column 'v', found none"),
        ("t,v,v\n0,1,5\n1,2,6\n", "column v: expected one column of that name, found 2"),
        ("0.0,1.0\n1.0,2.0\n", "line 1: expected a header that names the columns, found numbers"),
        ("t v\n0;1\n1;2\n", "line 1: expected names separated by ','"),
    ],
)
def test_a_bad_table_is_refused_with_its_place(text, message, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(DatasetError, match=re.escape(str(path))) as caught:
        read(path)
    assert message in str(caught.value)


def test_a_missing_column_is_refused_with_similar_ones(tmp_path):
    path = write_csv(tmp_path / "a.csv", {"t": [0, 1], "VehicleSpeed": [1, 2], "Steer": [0, 0]})
    with pytest.raises(DatasetError, match="Did you mean VehicleSpeed"):
        read(path, ("vehicle_speed",))


def test_rows_every_24_ms_are_refused_where_25_ms_is_given(tmp_path):
    path = write_csv(tmp_path / "a.csv", {"t": np.arange(100) * 0.024, "v": np.arange(100)})
    with pytest.raises(DatasetError, match=r"column t, line 3: expected a row every 25 ms.*24 ms"):
        read(path, time=TimeMapping(column="t", period_s=0.025))


def test_a_mapping_without_time_is_refused(tmp_path):
    path = write_csv(tmp_path / "a.csv", {"t": [0, 1], "v": [1, 2]})
    with pytest.raises(DatasetError, match=r"Write \[time\]"):
        read(path, time=TimeMapping())


def test_another_encoding_is_refused_with_the_setting_to_change(tmp_path):
    text = "t,v,°\n0,1,2\n1,2,3\n".encode("latin-1")
    with pytest.raises(DatasetError, match=r"\[csv\] encoding"):
        values_of(text, tmp_path)
    assert values_of(text, tmp_path, encoding="latin-1")[1] == [1.0, 2.0]


def test_a_truncated_archive_is_refused(tmp_path):
    path = tmp_path / "a.csv.gz"
    rows = "".join(f"{k},{k * 7919 % 1009}\n" for k in range(2000))
    whole = gzip.compress(f"t,v\n{rows}".encode())
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match="truncated"):
        read(path)
