"""The last known road, from where the car is now, and curvatures that do not continue it."""

import pytest

from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import CurvaturePreview
from rt_controller.safety.path import LastRoad

ROAD = CurvaturePreview(4.0, 0.0, 0.001, 0.002, 0.003, 0.004)
FLAT = CurvaturePreview(4.0, *[0.001] * 5)


def begun(preview):
    values = [0.0] * len(Quantity)
    road = LastRoad(values, 2e-3)
    road.begin(preview)
    return road, values


@pytest.mark.parametrize(
    ("moved_m", "ahead_per_m"),
    [
        (6.0, (0.0015, 0.0025, 0.0035, 0.004, 0.004)),  # constant behind its last value
        (4.0, (0.001, 0.002, 0.003, 0.004, 0.004)),
        (-40.0, (0.0,) * 5),  # and before its first one
    ],
)
def test_the_road_ahead_moves_with_the_car(moved_m, ahead_per_m):
    road, _ = begun(ROAD)
    road.move(moved_m)
    assert road.curvature_here(0.5) == pytest.approx(ahead_per_m[0])
    assert road.ahead(None) == pytest.approx((4.0, *ahead_per_m))
    road, _ = begun(ROAD._replace(k0_per_m=0.0005))
    road.move(-40.0)
    assert road.curvature_here(0.5) == 0.0005


def test_behind_its_end_and_without_a_preview_the_curvature_is_the_last_one():
    road, _ = begun(ROAD)
    road.move(16.0)
    assert road.curvature_here(0.5) == 0.5
    road.move(4.0)
    assert road.curvature_here(0.5) == 0.5
    road, values = begun(None)
    assert road.curvature_here(0.5) == 0.5
    road.compare(0.5)
    assert values[Quantity.CURVATURE_STEP_PER_M] == 0.0
    assert road.ahead(None) is None


def test_a_preview_that_continues_the_one_before_is_used():
    road, values = begun(ROAD)
    road.move(2.0)
    next_one = CurvaturePreview(4.0, 0.0005, 0.0015, 0.0025, 0.0035, 0.0045)
    road.take(next_one, 0.0005)
    assert values[Quantity.PREVIEW_STEP_PER_M] == 0.0
    assert road.ahead(next_one) is next_one


@pytest.mark.parametrize("knot", range(4))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_preview_that_jumps_anywhere_is_replaced_by_the_one_before(knot, side):
    """A jump is reduced by one and a half times the changes of the road."""
    road, values = begun(FLAT)
    wrong = FLAT._replace(**{f"k{knot}_per_m": 0.001 + side * 0.009})
    road.take(wrong, wrong.k0_per_m)
    assert values[Quantity.PREVIEW_STEP_PER_M] == pytest.approx(0.009)
    assert road.ahead(wrong) == FLAT
    road, values = begun(ROAD)
    road.take(ROAD._replace(**{f"k{knot}_per_m": 0.001 * knot + side * 0.005}), None)
    assert values[Quantity.PREVIEW_STEP_PER_M] == pytest.approx(0.0035)


@pytest.mark.parametrize(
    ("before", "after", "step_per_m"),
    [
        ((0, 0, 0, 0, 0), (0, 8, 0, 0, 32), 0.0),  # a quarter of the bend
        ((0, 0, 0, 0, 0), (0, 7, 0, 0, 32), 0.0),
        ((32, 0, 0, 0, 0), (32, 0, 0, 8, 8), 0.0),
        ((0, 0, 0, 0, 0), (0, 8, 0, 0, 31), 8.0),
        ((20, 20, 20, 20, 20), (20, 11, 20, 20, 20), 9.0),  # a sharp curve is no bend
        ((-20, -20, -20, -20, -20), (-20, -11, -20, -20, -20), 9.0),
    ],
)
def test_a_sudden_bend_elsewhere_may_ripple_the_road(before, after, step_per_m):
    """Curvatures in 1/1024 m."""
    road, values = begun(CurvaturePreview(4.0, *(k / 1024.0 for k in before)))
    road.take(CurvaturePreview(4.0, *(k / 1024.0 for k in after)), None)
    assert values[Quantity.PREVIEW_STEP_PER_M] * 1024.0 == pytest.approx(step_per_m)


def test_a_preview_that_contradicts_the_curvature_at_the_car_is_no_finding():
    road, values = begun(FLAT)
    wrong = CurvaturePreview(4.0, *[0.01] * 5)
    road.take(wrong, 0.001)
    assert values[Quantity.PREVIEW_STEP_PER_M] == 0.0
    assert road.ahead(wrong) == FLAT
    road.begin(FLAT)
    road.take(wrong, None)
    assert values[Quantity.PREVIEW_STEP_PER_M] == pytest.approx(0.009)


def test_a_preview_after_a_long_gap_is_accepted():
    road, values = begun(FLAT)
    road.move(20.0)
    other = CurvaturePreview(4.0, *[0.01] * 5)
    road.take(other, 0.01)
    assert values[Quantity.PREVIEW_STEP_PER_M] == 0.0
    assert road.ahead(other) is other


def test_a_preview_that_was_taken_before_is_not_compared_again():
    road, values = begun(FLAT)
    wrong = FLAT._replace(k2_per_m=0.01)
    road.take(wrong, 0.001)
    values[Quantity.PREVIEW_STEP_PER_M] = 0.0
    road.take(wrong, 0.001)
    road.take(None, 0.001)
    assert values[Quantity.PREVIEW_STEP_PER_M] == 0.0


BEND = CurvaturePreview(4.0, 0.0, 0.0, 0.01, 0.01, 0.01)

EARLY, LATE = (CurvaturePreview(4.0, *ends) for ends in ((0.01, 0, 0, 0, 0), (0, 0, 0, 0, 0.01)))


@pytest.mark.parametrize(
    ("preview", "moved_m", "curvature_per_m", "step_per_m"),
    [
        (FLAT, 2.0, 0.001, 0.0),
        (FLAT, 2.0, 0.006, 0.005),
        (FLAT, 30.0, 0.03, 0.0),  # the road is known no further
        (ROAD, -4.0, -10.0, 0.0),  # nor from one interval behind its begin
        (ROAD, -3.9, -10.0, 9.997525),
        *((ROAD, 2.0, 0.0005 + step, abs(step)) for step in (0.0015, -0.0015, 0.002)),
        # a bend that was seen ahead is no step
        *((BEND, moved_m, 0.0, 0.0) for moved_m in (3.0, 5.0)),
        *((BEND, moved_m, 0.01, 0.0) for moved_m in (7.0, 9.0)),
        # the change of the nearest interval counts on both sides, and no other
        (LATE, 6.0, 0.01, 0.01),
        (LATE, 10.0, 0.01, 0.0),
        (EARLY, 6.0, 0.01, 0.0),
        (EARLY, 10.0, 0.01, 0.01),
    ],
)
def test_the_curvature_at_the_car_is_compared_as_far_as_the_road_is_known(
    preview, moved_m, curvature_per_m, step_per_m
):
    road, values = begun(preview)
    road.move(moved_m)
    road.compare(curvature_per_m)
    assert values[Quantity.CURVATURE_STEP_PER_M] == pytest.approx(step_per_m)


def test_the_end_of_the_road_that_is_known_is_not_compared():
    for moved_m, expected in ((15.9, 0.1 - 0.003975 - 0.0015), (16.0, 0.0)):
        road, values = begun(ROAD)
        road.move(moved_m)
        road.compare(0.1)
        assert values[Quantity.CURVATURE_STEP_PER_M] == pytest.approx(expected)
        assert road.curvature_here(0.5) == pytest.approx(0.003975 if expected else 0.5)


def test_a_step_of_the_largest_allowed_size_is_accepted():
    road, values = begun(CurvaturePreview(4.0, *[0.0] * 5))
    stepped = CurvaturePreview(4.0, *[0.002] * 5)
    road.take(stepped, None)
    assert values[Quantity.PREVIEW_STEP_PER_M] == 0.002  # within the limit, and shown
    assert road.ahead(stepped) is stepped
    assert road.curvature_here(0.5) == 0.002


def test_an_accepted_preview_begins_at_the_car():
    road, _ = begun(ROAD)
    road.move(4.0)
    road.take(ROAD._replace(k4_per_m=0.004, k0_per_m=0.0015), None)
    assert road.curvature_here(0.5) == 0.0015
    road.move(4.0)
    assert road.curvature_here(0.5) == 0.001
    road.begin(ROAD)
    assert road.curvature_here(0.5) == 0.0


def test_where_no_road_is_known_any_more_a_preview_that_contradicts_the_car_is_not_taken():
    road, _ = begun(FLAT)
    road.move(16.0)
    wrong = CurvaturePreview(4.0, *[0.01] * 5)
    road.take(wrong, 0.001)
    assert road.curvature_here(0.001) == 0.001
    right = CurvaturePreview(4.0, *[0.0011] * 5)
    road.take(right, 0.001)
    assert road.ahead(right) is right


@pytest.mark.parametrize("back_m", [-3.9, -4.0, -7.0, -100.0, float("-inf"), float("nan")])
def test_a_car_that_has_rolled_back_raises_nothing_and_has_the_road_from_its_beginning(back_m):
    road, values = begun(ROAD)
    road.move(back_m)
    road.compare(0.0)
    assert values[Quantity.CURVATURE_STEP_PER_M] <= 1e-3
    road.take(FLAT._replace(spacing_m=0.05), 0.001)
    assert abs(road.curvature_here(0.0)) <= 1e-3
    road.ahead(None)
