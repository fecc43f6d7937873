"""Records of different lengths and periods are compared over windows."""

import numpy as np
import pytest

from rt_controller.gateway.window_comparison import (
    LONGEST_LOG_S,
    STEP_S,
    Agreement,
    compare,
    grid_of,
    integrals,
    on_grid,
)


def test_a_clock_that_was_set_does_not_make_a_grid_of_decades():
    times_s = grid_of([[(0.0, 1.0), (1.7e9, 1.0)]])
    assert len(times_s) == pytest.approx(LONGEST_LOG_S / STEP_S, abs=2)


def test_no_samples_have_no_times():
    assert len(grid_of([[], []])) == 0
    assert len(integrals(np.empty(0), 4)) == 0


def test_a_long_gap_is_not_interpolated():
    values = on_grid([(0.0, 1.0), (0.1, 2.0), (2.0, 3.0)], np.array([0.05, 1.0]))
    assert values[0] == pytest.approx(1.5)
    assert np.isnan(values[1])


@pytest.mark.parametrize(
    ("factor", "agreement"),
    [(2.0, Agreement.SAME_SIGN), (-0.5, Agreement.OPPOSITE_SIGN)],
)
def test_sign_and_factor_are_those_of_the_records(factor, agreement):
    expected = np.sin(np.linspace(0.0, 20.0, 200))
    found = compare(expected, factor * expected, least=0.1)
    assert found.agreement is agreement
    assert found.factor == pytest.approx(factor)


def test_records_without_a_relation_agree_in_no_sign():
    angle = np.linspace(0.0, 40.0, 400)
    assert compare(np.sin(angle), np.cos(angle), least=0.1).agreement is Agreement.NONE
