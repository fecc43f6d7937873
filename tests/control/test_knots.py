"""Knots are close at the begin of the horizon and further apart after it."""

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.control.terms import place_knots


def test_intervals_are_two_periods_first_and_then_four() -> None:
    knots = place_knots(40, 14)
    assert knots.intervals.tolist() == [2.0] * 8 + [4.0] * 6
    assert knots.stages == (0, 2, 4, 6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 36)
    assert knots.ends == (*knots.stages[1:], 40)
    assert knots.unit == 2


@pytest.mark.parametrize("count", [None, 12])
def test_without_a_number_there_is_a_knot_at_each_stage(count: int | None) -> None:
    knots = place_knots(12, count)
    assert knots.stages == tuple(range(12))
    assert knots.unit == 1
    np.testing.assert_array_equal(knots.interpolation, np.eye(12))


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_between_the_knots_the_inputs_are_straight_lines_and_constant_behind_the_last(
    count: int,
) -> None:
    knots = place_knots(12, count)
    assert knots.count == count
    assert knots.intervals.sum() == 12
    values = np.random.default_rng(count).normal(size=count)
    expected = np.interp(np.arange(12), knots.stages, values)
    np.testing.assert_allclose(knots.interpolation @ values, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("horizon", "count"), [(12, 2), (12, 7), (12, 13), (13, 5), (40, 9)])
def test_other_numbers_are_refused(horizon: int, count: int) -> None:
    with pytest.raises(ConfigError, match=r"mpc\.knots"):
        place_knots(horizon, count)
