"""What stands out is counted and the worst of it named with its place."""

from pathlib import Path

import numpy as np
import pytest

from offline.logs.column_mapping import Sampling
from offline.logs.outliers import find_outliers, remarks, robust_z
from offline.logs.series import Drive, Series


def drive_of(values, file="a.csv", jumps=0, gap=None):
    t_s = 0.01 * np.arange(len(values))
    bridged = np.arange(len(values) - 1) != gap
    rows = np.arange(1, len(values) + 1)
    one = Series("v", "m/s", "v", t_s, values, rows, Sampling.SAMPLED, bridged, jumps)
    return Drive(Path(file), "row", len(values), (one,), ())


def smooth(seed=0, count=2000):
    t = 0.01 * np.arange(count)
    return np.sin(t) + 0.002 * np.random.default_rng(seed).normal(size=count)


def test_a_good_signal_has_none():
    (found,) = find_outliers([drive_of(smooth())])
    assert (found.far, found.sudden) == (0, 0)
    assert remarks([found], []) == []


def test_a_spike_is_found_in_the_file_and_row_where_it_is():
    spoiled = smooth(1)
    spoiled[700] += 3.0
    (found,) = find_outliers([drive_of(smooth()), drive_of(spoiled, "b.csv")])
    assert found.sudden == 2, "up and down again"
    assert found.worst in ("b.csv, row 701", "b.csv, row 702")
    (remark,) = remarks([found], [])
    assert "b.csv" in remark.says


def test_the_seam_between_two_files_is_no_increment():
    (found,) = find_outliers([drive_of(smooth()), drive_of(50.0 + smooth(1), "b.csv")])
    assert found.sudden == 0


def test_what_happens_in_a_gap_is_no_increment():
    values = np.concatenate([smooth(), 50.0 + smooth(1)])
    (found,) = find_outliers([drive_of(values, gap=1999)])
    assert found.sudden == 0
    (found,) = find_outliers([drive_of(values)])
    assert found.sudden == 1


def test_values_far_from_all_others_are_counted():
    spoiled = smooth()
    spoiled[500:520] = 200.0
    (found,) = find_outliers([drive_of(spoiled)])
    assert found.far == 20


def test_a_pedal_is_allowed_to_stand_out_but_not_to_jump_beyond_its_limit():
    pedal = np.zeros(2000)
    pedal[1000:1003] = 1.0
    (found,) = find_outliers([drive_of(pedal)])
    assert remarks([found], ["v"]) == []
    (remark,) = remarks([found._replace(jumps=2)], ["v"])
    assert remark.about == "jumps"


def test_a_mostly_constant_signal_has_a_spread_all_the_same():
    values = np.zeros(1000)
    values[::100] = 1.0
    assert np.max(np.abs(robust_z(values))) == pytest.approx(50.0, rel=0.1)
    assert np.array_equal(robust_z(np.ones(5)), np.zeros(5))
