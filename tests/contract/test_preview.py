"""Five values of curvature describe the road over a horizon; the heading fits best."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.bus.messages import PREVIEW
from rt_controller.contract.arrays import Array
from rt_controller.contract.preview import (
    INTERVALS,
    KNOTS,
    LARGEST_PER_M,
    LONGEST_SPACING_M,
    SHORTEST_SPACING_M,
    fit_preview,
    is_plausible,
)
from rt_controller.contract.signals import CurvaturePreview

curvatures = st.floats(-0.03, 0.03)
unclipped = st.floats(-0.02, 0.02)
"""the fit of a step between two of these stays within the signals of the bus"""


def heading_rad(distance_m: Array, curvature_per_m: Array) -> Array:
    mean = 0.5 * (curvature_per_m[1:] + curvature_per_m[:-1])
    return np.concatenate([[0.0], np.cumsum(mean * np.diff(distance_m))])


def curvature_of(preview: CurvaturePreview, distance_m: Array) -> Array:
    return np.interp(distance_m, preview.spacing_m * np.arange(KNOTS), preview[1:])


@given(curvatures, st.floats(0.2, 100.0), st.integers(KNOTS, 60))
def test_a_circle_has_five_equal_values(curvature, reach_m, count):
    preview = fit_preview(np.full(count, curvature), reach_m)
    assert preview == (reach_m / INTERVALS, *[curvature] * KNOTS)


@given(st.lists(curvatures, min_size=KNOTS, max_size=KNOTS), st.integers(1, 12))
def test_straight_lines_between_the_five_places_are_exact(values, parts):
    place = np.linspace(0.0, INTERVALS, INTERVALS * parts + 1)
    preview = fit_preview(np.interp(place, range(KNOTS), values), 20.0)
    np.testing.assert_allclose(preview[1:], values, atol=1e-12)


@given(st.floats(0.0, 1.0), curvatures, curvatures)
def test_of_a_sudden_bend_the_heading_is_kept(place, before, after):
    """To an eighth of what the car turns by within one spacing; five samples: to a half."""
    reach_m, largest = 13.3, LARGEST_PER_M / 2.0
    distance_m = np.linspace(0.0, reach_m, 33)
    road = np.clip(np.where(distance_m < place * reach_m, before, after), -largest, largest)
    preview = fit_preview(road, reach_m)
    found = heading_rad(distance_m, curvature_of(preview, distance_m))
    error = np.abs(found - heading_rad(distance_m, road)).max()
    assert error <= 0.125 * np.ptp(road) * preview.spacing_m + 1e-12


def test_a_sudden_bend_near_the_limit_stays_within_the_signals_of_the_bus():
    for place in range(1, 33):
        road = np.where(np.arange(33) < place, 0.0, LARGEST_PER_M)
        assert np.abs(fit_preview(road, 10.0)[1:]).max() <= LARGEST_PER_M
    signals = [signal for codec in PREVIEW.codecs for signal in codec.signals]
    spacing, *others = signals
    assert {signal.raw_max * signal.scale for signal in others} == {LARGEST_PER_M}
    ends_m = [raw * spacing.scale for raw in (spacing.raw_min, spacing.raw_max)]
    assert ends_m == pytest.approx([SHORTEST_SPACING_M, LONGEST_SPACING_M])


@pytest.mark.parametrize(
    ("values", "reach_m", "message"),
    [
        (np.zeros(4), 10.0, "at least 5 values at equal distances, found the shape"),
        (np.zeros(9), 0.0, "a spacing of 0.05 to 65.5 m between five values, found 0 m"),
        (np.zeros(9), math.nan, "found nan m"),
        (np.linspace(0.0, 0.2, 9), 10.0, "curvatures of at most 0.16 1/m, found 0.175 1/m"),
        (np.array([0.0, 0.0, math.nan, 0.0, 0.0]), 10.0, "found nan 1/m"),
    ],
)
def test_values_that_the_bus_cannot_carry_are_refused(values, reach_m, message):
    with pytest.raises(ValueError, match=f"expected .*{message}"):
        fit_preview(values, reach_m)


@given(st.floats(0.0, 1.0), unclipped, unclipped, st.integers(0, 3))
def test_a_sudden_bend_is_plausible_on_the_way_to_it_and_for_three_periods(
    place, before, after, age
):
    reach_m, period_m = 13.3, 13.3 / 24.0
    road = np.where(np.linspace(0.0, 1.0, 33) < place, before, after)
    now = before if age * period_m < place * reach_m else after
    assert is_plausible(fit_preview(road, reach_m), now)


def test_a_preview_of_another_road_is_not_plausible():
    circle = CurvaturePreview(3.0, *[0.005] * KNOTS)
    assert not is_plausible(circle, 0.0)
    assert not is_plausible(circle._replace(k1_per_m=0.006), 0.0)
    assert is_plausible(circle, 0.0046)  # two sources of one road differ
