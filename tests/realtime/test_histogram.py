"""Percentiles of any number of values, from a fixed number of buckets."""

import numpy as np
import pytest

from rt_controller.realtime.timing import Histogram


def of(values: np.ndarray) -> Histogram:
    histogram = Histogram()
    for value in values.tolist():
        histogram.add(value)
    return histogram


@pytest.mark.parametrize("seed", range(4))
def test_a_percentile_is_a_recorded_value_at_most_one_per_cent_above_the_exact_one(
    seed: int,
) -> None:
    values = np.random.default_rng(seed).lognormal(5.0, 1.5, size=20_000)
    found = of(values).percentiles()
    exact = np.sort(values)[[9_999, 19_799, 19_979]]
    for value, expected in zip(found[:3], exact, strict=True):
        assert value in values
        assert expected <= value <= 1.01 * expected
    assert found.max == values.max()
    assert found.mean == pytest.approx(values.mean())


def test_small_whole_numbers_are_exact() -> None:
    assert of(np.repeat([1.0, 2.0, 16.0], [98, 1, 1])).percentiles() == (
        1.0,
        2.0,
        16.0,
        16.0,
        pytest.approx(1.16),
    )


def test_without_values_all_percentiles_are_zero() -> None:
    assert Histogram().percentiles() == (0.0,) * 5


@pytest.mark.parametrize("value", [0.0, -3.0, 0.05])
def test_values_below_the_lowest_bucket_count_as_the_smallest(value: float) -> None:
    found = of(np.array([value, 5.0, 7.0, 9.0])).percentiles()
    assert found.p50 == 5.0
    assert found.max == 9.0


@pytest.mark.parametrize("value", [1e9, 1e12, float("inf")])
def test_values_above_the_highest_bucket_count_as_the_largest(value: float) -> None:
    assert of(np.array([5.0, value])).percentiles().max == value
