"""Where a log has no samples is told, with the place of the first such time."""

import numpy as np
import pytest
from made_logs import MAPPING, make_drive, rounded, write_csv

from offline.logs.csv_log import read_csv
from offline.logs.gap import find_gaps, remarks
from offline.logs.series import to_drive


def gaps_of(parse, folder, lost, text=MAPPING):
    columns = {name: np.array(values) for name, values in rounded(make_drive(10.0)).items()}
    kept = np.ones(len(columns["time"]), dtype=bool)
    for begin, end in lost:
        kept[begin:end] = False
    path = folder / "a.csv"
    write_csv(path, {name: values[kept].tolist() for name, values in columns.items()})
    mapping = parse(text)
    return find_gaps(to_drive(read_csv(path, mapping.columns, mapping.time, mapping.csv), mapping))


def test_a_whole_log_has_none(parse, tmp_path):
    found = gaps_of(parse, tmp_path, [])
    assert found.number == 0
    assert remarks([found]) == []


def test_two_lost_rows_are_bridged_and_are_no_gap(parse, tmp_path):
    assert gaps_of(parse, tmp_path, [(300, 302)]).number == 0


def test_gaps_are_counted_and_the_first_is_named_with_its_line(parse, tmp_path):
    found = gaps_of(parse, tmp_path, [(300, 400), (600, 650)])
    assert (found.file, found.number) == ("a.csv", 2)
    assert found.missing_s == pytest.approx(1.01 + 0.51)
    assert found.first == "vx_mps, line 302"
    (remark,) = remarks([found])
    assert "vx_mps, line 302" in remark.says


def test_the_signal_that_misses_most_speaks_for_the_log(parse, tmp_path):
    text = MAPPING.replace('"side", unit = "m/s"', '"side", unit = "m/s", longest_gap_s = 0.005')
    found = gaps_of(parse, tmp_path, [], text)
    assert found.number == 1000
    assert found.first == "vy_mps, line 3"


def test_what_is_cut_because_it_is_not_kept_is_no_gap(parse, tmp_path):
    text = MAPPING.replace('"speed", unit = "m/s"', '"speed", unit = "m/s", keep = [15.5, 60.0]')
    assert gaps_of(parse, tmp_path, [], text).number == 0
