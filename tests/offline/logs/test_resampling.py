"""Stretches end at gaps, and within them every signal is resampled to one period."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from offline.logs.readers.log import Series
from offline.logs.series import LoggedDrive, Stretch, find_stretches, grid, resample
from rt_controller.mapping.tables import Sampling

PERIOD_S = 0.025


def series(t_s, values, sampling=Sampling.SAMPLED, longest_s=0.1):
    t_s, values = np.asarray(t_s, dtype=float), np.asarray(values, dtype=float)
    connected = np.diff(t_s) <= longest_s
    rows, names = np.arange(len(t_s)), {"path": Path("a.csv"), "name": "v"}
    return Series("v", t_s, values, rows, "m/s", **names, sampling=sampling, connected=connected)


def whole(one):
    return Stretch(float(one.t_s[0]), float(one.t_s[-1]))


def test_stretches_are_where_all_signals_are_known():
    fast = series([0.0, 0.05, 0.1, 0.5, 0.55, 0.6], range(6))
    late = series([0.02, 0.08, 0.14, 0.2, 0.28, 0.36, 0.44, 0.52, 0.58], range(9))
    drive = LoggedDrive("a.csv", 6, (fast, late))
    assert find_stretches(drive) == [Stretch(0.02, 0.1), Stretch(0.5, 0.58)]


def test_the_grid_loses_no_sample_to_rounding():
    assert len(grid(Stretch(0.1, 0.1 + 80 * PERIOD_S), PERIOD_S)) == 81
    assert len(grid(Stretch(0.1, 0.1 + 79.9 * PERIOD_S), PERIOD_S)) == 80


RAMP = 0.01 * np.arange(101)
NOISE = np.random.default_rng(0).normal(size=50)


@pytest.mark.parametrize(
    ("sampling", "t_s", "values", "expected"),
    [
        (Sampling.SAMPLED, 3.0 + PERIOD_S * np.arange(50), NOISE, NOISE),
        (Sampling.SAMPLED, [0.0, 0.04, 0.08], [0.0, 4.0, 0.0], [0.0, 2.5, 3.0, 0.5]),
        # Averaging does not shift a ramp at its ends.
        (Sampling.SAMPLED, RAMP, 7.0 * RAMP, 7.0 * PERIOD_S * np.arange(41)),
        (Sampling.MEAN, RAMP, RAMP, [*PERIOD_S * (np.arange(40) + 0.5), 1.0]),
        # A held command is weighted by its duration.
        (Sampling.HELD, [0.0, 0.01, 0.04, 0.1], [1.0, 2.0, 4.0, 8.0], [1.6, 2.8, 4.0, 4.0, 8.0]),
    ],
)
def test_a_signal_gets_one_sample_per_period(sampling, t_s, values, expected):
    one = series(t_s, values, sampling)
    found = resample(one, whole(one), grid(whole(one), PERIOD_S), PERIOD_S)
    assert found == pytest.approx(np.asarray(expected), abs=1e-9)


def test_fast_samples_are_averaged_so_that_no_frequency_is_aliased():
    """40 Hz sampled every 25 ms would appear as a constant."""
    t = 0.001 * np.arange(2001)
    slow, fast = np.sin(2 * np.pi * 1.0 * t), np.cos(2 * np.pi * 40.0 * t)
    one = series(t, slow + fast)
    t_s = grid(whole(one), PERIOD_S)
    found = resample(one, whole(one), t_s, PERIOD_S)
    expected = np.sin(2 * np.pi * t_s)
    assert np.max(np.abs(found - expected)[1:-1]) < 0.01


def test_samples_beyond_a_gap_do_not_influence_a_stretch():
    t = np.concatenate([0.005 * np.arange(41), 1.0 + 0.005 * np.arange(41)])
    one = series(t, np.where(t < 0.5, 1.0, 100.0))
    drive = LoggedDrive("a.csv", 82, (one,), ())
    for stretch, value in zip(find_stretches(drive), (1.0, 100.0), strict=True):
        for sampling in Sampling:
            held = replace(one, sampling=sampling)
            found = resample(held, stretch, grid(stretch, PERIOD_S), PERIOD_S)
            assert found == pytest.approx(np.full(len(found), value))
