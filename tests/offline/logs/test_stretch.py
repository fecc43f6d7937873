"""Gaps cut, and between them every signal is brought to one period without looking across."""

from pathlib import Path

import numpy as np
import pytest

from offline.logs.column_mapping import Sampling
from offline.logs.series import Drive, Series
from offline.logs.stretch import Stretch, find_stretches, grid, resample, window_mean

PERIOD_S = 0.025


def series(t_s, values, sampling=Sampling.SAMPLED, longest_s=0.1):
    t_s, values = np.asarray(t_s, dtype=float), np.asarray(values, dtype=float)
    bridged = np.diff(t_s) <= longest_s
    rows = np.arange(len(t_s))
    return Series("v", "m/s", "v", t_s, values, rows, sampling, bridged, 0)


def whole(one):
    return Stretch(float(one.t_s[0]), float(one.t_s[-1]))


def test_stretches_are_where_all_signals_are_known():
    fast = series([0.0, 0.05, 0.1, 0.5, 0.55, 0.6], range(6))
    late = series([0.02, 0.08, 0.14, 0.2, 0.28, 0.36, 0.44, 0.52, 0.58], range(9))
    drive = Drive(Path("a.csv"), "line", 6, (fast, late), ())
    assert find_stretches(drive) == [Stretch(0.02, 0.1), Stretch(0.5, 0.58)]


def test_a_delay_is_made_up_for_before_stretches_are_found():
    on_time, late = series([0.0, 0.05, 0.1], range(3)), series([-0.03, 0.02, 0.07], range(3))
    drive = Drive(Path("a.csv"), "line", 3, (on_time, late), ())
    assert find_stretches(drive) == [Stretch(0.0, 0.07)]


def test_the_grid_loses_no_sample_to_rounding():
    assert len(grid(Stretch(0.1, 0.1 + 80 * PERIOD_S), PERIOD_S)) == 81
    assert len(grid(Stretch(0.1, 0.1 + 79.9 * PERIOD_S), PERIOD_S)) == 80


def test_samples_at_the_period_pass_unchanged():
    values = np.random.default_rng(0).normal(size=50)
    one = series(3.0 + PERIOD_S * np.arange(50), values)
    t_s = grid(whole(one), PERIOD_S)
    np.testing.assert_allclose(resample(one, whole(one), t_s, PERIOD_S), values, atol=1e-9)


def test_slow_samples_are_joined_by_straight_lines():
    one = series([0.0, 0.04, 0.08], [0.0, 4.0, 0.0])
    t_s = grid(whole(one), PERIOD_S)
    assert resample(one, whole(one), t_s, PERIOD_S) == pytest.approx([0.0, 2.5, 3.0, 0.5])


def test_what_the_period_cannot_show_is_averaged_out_of_fast_samples():
    """40 Hz at a period of 25 ms would be taken for a constant."""
    t = 0.001 * np.arange(2001)
    slow, fast = np.sin(2 * np.pi * 1.0 * t), np.cos(2 * np.pi * 40.0 * t)
    one = series(t, slow + fast)
    t_s = grid(whole(one), PERIOD_S)
    found = resample(one, whole(one), t_s, PERIOD_S)
    expected = np.sin(2 * np.pi * t_s)
    assert np.max(np.abs(found - expected)[1:-1]) < 0.01


def test_averaging_shifts_nothing_at_the_ends():
    one = series(0.01 * np.arange(101), 7.0 * 0.01 * np.arange(101))
    t_s = grid(whole(one), PERIOD_S)
    assert resample(one, whole(one), t_s, PERIOD_S) == pytest.approx(7.0 * t_s)


def test_a_held_command_counts_for_as_long_as_it_lasts():
    one = series([0.0, 0.01, 0.04, 0.1], [1.0, 2.0, 4.0, 8.0], Sampling.HELD)
    t_s = grid(whole(one), PERIOD_S)
    found = resample(one, whole(one), t_s, PERIOD_S)
    assert found == pytest.approx([(0.01 * 1 + 0.015 * 2) / 0.025, 2.8, 4.0, 4.0, 8.0])


def test_the_mean_over_the_period_is_half_a_period_ahead_of_a_ramp():
    one = series(0.005 * np.arange(101), 0.005 * np.arange(101), Sampling.MEAN)
    t_s = grid(whole(one), PERIOD_S)
    found = resample(one, whole(one), t_s, PERIOD_S)
    assert found[:-1] == pytest.approx(t_s[:-1] + 0.5 * PERIOD_S)


def test_nothing_is_seen_across_a_gap():
    t = np.concatenate([0.005 * np.arange(41), 1.0 + 0.005 * np.arange(41)])
    one = series(t, np.where(t < 0.5, 1.0, 100.0))
    drive = Drive(Path("a.csv"), "line", 82, (one,), ())
    for stretch, value in zip(find_stretches(drive), (1.0, 100.0), strict=True):
        for sampling in Sampling:
            held = Series(*(getattr(one, f) for f in one.__slots__[:6]), sampling, one.bridged, 0)
            found = resample(held, stretch, grid(stretch, PERIOD_S), PERIOD_S)
            assert found == pytest.approx(np.full(len(found), value))


@pytest.mark.parametrize("is_held", [False, True])
def test_window_means_are_those_of_a_fine_sum(is_held):
    dice = np.random.default_rng(1)
    t = np.cumsum(dice.uniform(0.01, 0.1, 40))
    values = dice.normal(size=40)
    low = np.sort(dice.uniform(t[0], t[-2], 15))
    high = low + 0.08
    fine = np.linspace(0.0, 1.0, 20001)
    expected = []
    for a, b in zip(low, np.minimum(high, t[-1]), strict=True):
        at = a + (b - a) * fine
        held = values[np.clip(np.searchsorted(t, at, side="right") - 1, 0, 39)]
        expected.append(np.mean(held if is_held else np.interp(at, t, values)))
    assert window_mean(t, values, low, high, is_held) == pytest.approx(expected, abs=1e-3)
