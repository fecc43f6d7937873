"""Intervals by the bootstrap of whole episodes."""

import numpy as np
import pytest

from offline.evaluation.bootstrap import (
    RESAMPLES,
    estimate,
    mean_draws,
    quantile_draws,
    tail_draws,
)


def mean_of(values, episode):
    return estimate(mean_draws(np.asarray(values), np.asarray(episode)))


def test_episodes_may_come_in_any_order():
    values, episode = np.arange(6.0), np.array([7, 3, 7, 9, 3, 7])
    order = np.argsort(episode)
    once, sorted_first = mean_of(values, episode), mean_of(values[order], episode[order])
    assert np.allclose(np.stack(once), np.stack(sorted_first), rtol=1e-12)


def test_the_mean_is_over_all_values_and_not_over_episode_means():
    assert mean_of([1.0, 2.0, 9.0], [0, 0, 1]).value == pytest.approx(4.0)


def test_the_same_sample_has_the_same_interval():
    rng = np.random.default_rng(0)
    values, episode = rng.normal(size=(60, 3)), np.repeat(np.arange(20), 3)
    once, again = mean_of(values, episode), mean_of(values, episode)
    assert np.array_equal(np.stack(once), np.stack(again))


def test_intervals_cover_the_true_mean_of_correlated_slices_as_often_as_stated():
    """Slices of an episode differ ten times less than episodes; the true mean is 0.

    Intervals from resampled slices would cover it about 6 times in 10.
    """
    rng = np.random.default_rng(1)
    episode = np.repeat(np.arange(40), 5)
    covered = 0
    for _ in range(300):
        values = np.repeat(rng.normal(size=40), 5) + 0.1 * rng.normal(size=200)
        found = mean_of(values, episode)
        covered += bool(found.low <= 0.0 <= found.high)
    assert 0.90 <= covered / 300 <= 0.98


def test_copies_of_the_slices_do_not_change_the_interval():
    rng = np.random.default_rng(2)
    values, episode = rng.normal(size=(30, 2)), np.arange(30)
    once = mean_of(values, episode)
    five_times = mean_of(np.repeat(values, 5, axis=0), np.repeat(episode, 5))
    assert np.allclose(np.stack(once), np.stack(five_times), rtol=1e-12)
    as_if_independent = mean_of(np.repeat(values, 5, axis=0), np.arange(150))
    assert np.all(as_if_independent.high - as_if_independent.low < 0.6 * (once.high - once.low))


def test_interval_of_many_episodes_has_the_width_of_a_normal_distribution():
    rng = np.random.default_rng(3)
    values = rng.normal(size=400)
    found = mean_of(values, np.arange(400))
    assert found.high - found.low == pytest.approx(2 * 1.96 * values.std() / 20.0, rel=0.06)


def test_a_single_episode_has_no_interval():
    found = mean_of([1.0, 3.0], [5, 5])
    assert found.value == 2.0
    assert np.isnan(found.low)
    assert np.isnan(found.high)


def test_a_value_that_is_not_finite_makes_only_its_own_mean_infinite():
    values = np.array([[1.0, np.inf, np.nan], [3.0, 1.0, 1.0], [5.0, 1.0, 1.0]])
    draws = mean_draws(values, np.arange(3))
    assert np.all(np.isfinite(draws[:, 0]))
    assert np.all(np.isinf(draws[:, 1:]))


def weights_of(episodes):
    """How often each episode was drawn (1 + R, E), read from means of indicators."""
    return np.rint(episodes * mean_draws(np.eye(episodes), np.arange(episodes))).astype(int)


def test_every_resample_is_as_long_as_the_sample():
    weights = weights_of(12)
    assert weights.shape == (1 + RESAMPLES, 12)
    assert np.all(weights[0] == 1)
    assert np.all(weights.sum(axis=1) == 12)
    assert len(np.unique(weights, axis=0)) > 0.9 * RESAMPLES


def test_quantiles_agree_with_those_of_explicit_resamples():
    rng = np.random.default_rng(4)
    episode = rng.integers(0, 10, 50)
    episode[:10] = np.arange(10)
    values = rng.normal(size=(50, 2, 3))
    shares = (0.5, 0.9, 0.99)
    draws = quantile_draws(values, episode, shares)
    assert draws.shape == (1 + RESAMPLES, 3, 2, 3)
    for row in (0, 1, 77, 1999):
        resampled = np.repeat(values, weights_of(10)[row][episode], axis=0)
        expected = np.quantile(resampled, shares, axis=0, method="inverted_cdf")
        assert np.array_equal(draws[row], expected)


def test_the_ninth_of_ten_is_the_90_percent_quantile():
    """0.9 times 10 is slightly more than 9 in binary."""
    draws = quantile_draws(np.arange(1.0, 11.0), np.arange(10), (0.9,))
    assert draws[0, 0] == 9.0


def test_the_part_of_the_largest_values_agrees_with_that_of_explicit_resamples():
    rng = np.random.default_rng(5)
    episode = np.arange(50) // 5
    values = rng.normal(size=(50, 2)) ** 2
    draws = tail_draws(values, episode, 0.1)
    assert draws.shape == (1 + RESAMPLES, 2)
    for row in (0, 1, 500, 2000):
        resampled = np.sort(np.repeat(values, weights_of(10)[row][episode], axis=0), axis=0)
        assert len(resampled) == 50
        assert np.allclose(draws[row], resampled[-5:].sum(axis=0) / resampled.sum(axis=0))


def test_the_number_of_the_largest_values_is_rounded_up():
    assert tail_draws(np.array([[1.0], [2.0], [5.0]]), np.arange(3), 0.4)[0, 0] == 7.0 / 8.0
    assert tail_draws(np.array([[1.0], [2.0], [5.0]]), np.arange(3), 0.01)[0, 0] == 5.0 / 8.0


def test_an_infinite_sum_has_no_largest_part():
    draws = tail_draws(np.array([[1.0], [np.inf], [3.0]]), np.zeros(3, dtype=int), 0.01)
    assert np.isnan(draws[0, 0])
