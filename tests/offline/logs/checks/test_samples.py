"""Gaps and outliers are counted, and the place of the first or worst is reported."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_logs import MAPPING, make_drive, rounded, write_csv

from offline.logs.checks.samples import (
    find_gaps,
    find_outliers,
    gap_issues,
    outlier_issues,
    robust_z,
)
from offline.logs.readers.log import RowsOf, Series
from offline.logs.readers.source import DriveFiles, read_log
from offline.logs.series import LoggedDrive, to_drive


def gaps_of(parse, folder, lost, text=MAPPING):
    columns = {name: np.array(values) for name, values in rounded(make_drive(10.0)).items()}
    kept = np.ones(len(columns["time"]), dtype=bool)
    for begin, end in lost:
        kept[begin:end] = False
    path = folder / "a.csv"
    write_csv(path, {name: values[kept].tolist() for name, values in columns.items()})
    mapping = parse(text)
    return find_gaps(to_drive(read_log(DriveFiles("a.csv", path), mapping), mapping))


def test_a_complete_log_has_no_gaps(parse, tmp_path):
    found = gaps_of(parse, tmp_path, [])
    assert found.number == 0
    assert not list(gap_issues([found]))


def test_two_lost_rows_are_not_a_gap(parse, tmp_path):
    assert gaps_of(parse, tmp_path, [(300, 302)]).number == 0


def test_gaps_are_counted_and_the_first_is_reported_with_its_line(parse, tmp_path):
    found = gaps_of(parse, tmp_path, [(300, 400), (600, 650)])
    assert (found.file, found.number) == ("a.csv", 2)
    assert found.missing_s == pytest.approx(1.01 + 0.51)
    assert found.first == "vx_mps, line 302"
    (issue,) = gap_issues([found])
    assert "vx_mps, line 302" in issue.message


def test_the_signal_with_the_longest_gaps_is_reported(parse, tmp_path):
    text = MAPPING.replace('"side", unit = "m/s"', '"side", unit = "m/s", longest_gap_s = 0.005')
    found = gaps_of(parse, tmp_path, [], text)
    assert found.number == 1000
    assert found.first == "vy_mps, line 3"


def test_a_cut_outside_the_keep_interval_is_not_a_gap(parse, tmp_path):
    text = MAPPING.replace('"speed", unit = "m/s"', '"speed", unit = "m/s", keep = [15.5, 60.0]')
    assert gaps_of(parse, tmp_path, [], text).number == 0


def drive_of(values, file="a.csv", jumps=0, gap=None):
    t_s = 0.01 * np.arange(len(values))
    connected = np.arange(len(values) - 1) != gap
    rows = np.arange(1, len(values) + 1)
    one = Series(
        "v",
        t_s,
        values,
        rows,
        "m/s",
        RowsOf(Path(file), "row"),
        name="v",
        connected=connected,
        jumps=jumps,
    )
    return LoggedDrive(file, len(values), (one,), ())


def smooth(seed=0, count=2000):
    t = 0.01 * np.arange(count)
    return np.sin(t) + 0.002 * np.random.default_rng(seed).normal(size=count)


def test_a_smooth_signal_has_no_outliers():
    (found,) = find_outliers([drive_of(smooth())])
    assert (found.far, found.sudden) == (0, 0)
    assert not list(outlier_issues([found], []))


def test_a_spike_is_reported_with_its_file_and_row():
    changed = smooth(1)
    changed[700] += 3.0
    (found,) = find_outliers([drive_of(smooth()), drive_of(changed, "b.csv")])
    assert found.sudden == 2, "up and down again"
    assert found.worst in ("b.csv, row 701", "b.csv, row 702")
    (issue,) = outlier_issues([found], [])
    assert "b.csv" in issue.message


def test_the_step_between_two_files_is_not_an_increment():
    (found,) = find_outliers([drive_of(smooth()), drive_of(50.0 + smooth(1), "b.csv")])
    assert found.sudden == 0


def test_the_step_over_a_gap_is_not_an_increment():
    values = np.concatenate([smooth(), 50.0 + smooth(1)])
    (found,) = find_outliers([drive_of(values, gap=1999)])
    assert found.sudden == 0
    (found,) = find_outliers([drive_of(values)])
    assert found.sudden == 1


def test_values_far_from_all_others_are_counted():
    changed = smooth()
    changed[500:520] = 200.0
    (found,) = find_outliers([drive_of(changed)])
    assert found.far == 20


def test_a_pedal_may_have_outliers_but_no_jumps():
    pedal = np.zeros(2000)
    pedal[1000:1003] = 1.0
    (found,) = find_outliers([drive_of(pedal)])
    assert not list(outlier_issues([found], ["v"]))
    (issue,) = outlier_issues([replace(found, jumps=2)], ["v"])
    assert issue.check == "jumps"


def test_a_mostly_constant_signal_has_a_finite_z_score():
    values = np.zeros(1000)
    values[::100] = 1.0
    assert np.max(np.abs(robust_z(values))) == pytest.approx(50.0, rel=0.1)
    assert np.array_equal(robust_z(np.ones(5)), np.zeros(5))
