"""Reference states are the path polynomial evaluated over the horizon."""

import math

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import CurvaturePreview, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.terms import place_knots

KNOTS = place_knots(20, 20)
CRUISING = VehicleState(20.0, 0.0, 0.0, 20.0 * PERIOD_S, 0.0, 0.0)


def test_on_a_straight_path_only_speed_and_progress_are_nonzero() -> None:
    x = ReferenceHorizon(KNOTS).expand(PathReference(1.0, 0, 0, 0, 20.0, 0.0), CRUISING, 0.0)
    np.testing.assert_allclose(x[:, 0], 20.0)
    np.testing.assert_allclose(x[:, 3], 20.0 * PERIOD_S)
    np.testing.assert_allclose(x[:, 4], 1.0)
    assert not x[:, [1, 2, 5]].any()


def test_stage_k_is_k_periods_ahead() -> None:
    path = PathReference(0.5, 0.1, 0.01, -0.0005, 20.0, 0.0)
    x = ReferenceHorizon(KNOTS).expand(path, CRUISING, 0.0)
    sigma = 20.0 * PERIOD_S * np.arange(21)
    np.testing.assert_allclose(x[:, 4], 0.5 + 0.1 * sigma + 0.01 * sigma**2 - 0.0005 * sigma**3)
    np.testing.assert_allclose(np.tan(x[:, 5]), 0.1 + 0.02 * sigma - 0.0015 * sigma**2)


def test_the_heading_error_changes_at_the_yaw_rate_minus_that_of_the_road() -> None:
    path = PathReference(0.0, 0.0, 0.002, 0.0, 20.0, 0.0)
    x = ReferenceHorizon(KNOTS).expand(path, CRUISING, 0.001)
    assert x[0, 2] == pytest.approx(20.0 * (0.001 + 0.004))
    turned = 0.5 * (x[0, 2] + x[-1, 2] - 40.0 * 0.001) * 20 * PERIOD_S
    assert x[-1, 5] - x[0, 5] == pytest.approx(turned, rel=0.01)


def test_a_slower_car_has_a_shorter_preview() -> None:
    path = PathReference(0.0, 0.1, 0.0, 0.0, 20.0, 0.0)
    fast = ReferenceHorizon(KNOTS).expand(path, CRUISING, 0.0)[-1, 4]
    slow = ReferenceHorizon(KNOTS).expand(path, CRUISING._replace(vx_mps=10.0), 0.0)[-1, 4]
    assert slow == pytest.approx(0.75 * fast)


def test_the_reference_speed_follows_the_reference_acceleration() -> None:
    x = ReferenceHorizon(KNOTS).expand(PathReference(0, 0, 0, 0, 20.0, -2.0), CRUISING, 0.0)
    np.testing.assert_allclose(x[:, 0], 20.0 - 2.0 * PERIOD_S * np.arange(21))


@pytest.mark.parametrize("seed", range(5))
def test_every_stage_is_the_path_evaluated_at_its_arc_length(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = PathReference(*rng.normal(size=4) * (1.0, 0.1, 1e-2, 1e-3), 4.0, rng.uniform(-9.0, 3.0))
    state = VehicleState(rng.uniform(5.0, 30.0), 0.1, 0.1, 0.5, 0.1, 0.01)
    curvature_per_m = rng.normal() * 0.01
    found = ReferenceHorizon(KNOTS).expand(path, state, curvature_per_m)
    for k, x in enumerate(found):
        t = k * PERIOD_S
        v = max(path.v_mps + path.a_mps2 * t, 0.0)
        sigma = 0.5 * (state.vx_mps + v) * t
        ey = path.c0_m + path.c1 * sigma + path.c2_per_m * sigma**2 + path.c3_per_m2 * sigma**3
        slope = path.c1 + 2 * path.c2_per_m * sigma + 3 * path.c3_per_m2 * sigma**2
        path_curvature = 2 * path.c2_per_m + 6 * path.c3_per_m2 * sigma
        expected = (
            v,
            0.0,
            v * (curvature_per_m + path_curvature),
            v * PERIOD_S,
            ey,
            math.atan(slope),
        )
        np.testing.assert_allclose(x, expected, rtol=1e-12, atol=1e-12)


PATH = PathReference(0.2, 0.01, 0.001, -2e-4, 21.0, 1.0)
SIGMA_M = 0.5 * (20.0 + 21.0 + PERIOD_S * np.arange(21)) * PERIOD_S * np.arange(21)
"""arc length of the stages on this path"""


def integrated(preview: CurvaturePreview, curvature_per_m: float) -> tuple[Array, Array, Array]:
    """Curvature, slope and lateral place of the road against a circle, by fine sums."""
    s = np.linspace(0.0, SIGMA_M[-1], 200_001)
    knots = preview.spacing_m * np.arange(5)
    bend = np.interp(s, knots, preview[1:]) - curvature_per_m
    slope = np.concatenate([[0.0], np.cumsum(0.5 * (bend[1:] + bend[:-1]) * s[1])])
    lateral = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * s[1])])
    at_stages = [np.interp(SIGMA_M, s, values) for values in (bend, slope, lateral)]
    return at_stages[0], at_stages[1], at_stages[2]


@pytest.mark.parametrize("seed", range(6))
def test_the_road_ahead_is_added_to_the_path(seed: int) -> None:
    """Also of a preview that ends within the horizon, or begins with another curvature."""
    rng = np.random.default_rng(seed)
    preview = CurvaturePreview(rng.uniform(1.0, 6.0), *(rng.normal(size=5) * 0.01).tolist())
    curvature_per_m = preview.k0_per_m if seed % 2 else 0.002
    horizon = ReferenceHorizon(KNOTS)
    plain = horizon.expand(PATH, CRUISING, curvature_per_m).copy()
    found = horizon.expand(PATH, CRUISING, curvature_per_m, preview)
    bend, slope, lateral = integrated(preview, curvature_per_m)
    np.testing.assert_array_equal(found[:, [0, 1, 3]], plain[:, [0, 1, 3]])
    np.testing.assert_allclose(found[:, 2], plain[:, 2] + found[:, 0] * bend, atol=1e-7)
    np.testing.assert_allclose(found[:, 4], plain[:, 4] + lateral, atol=1e-7)
    np.testing.assert_allclose(np.tan(found[:, 5]), np.tan(plain[:, 5]) + slope, atol=1e-7)


@pytest.mark.parametrize("curvature_per_m", [0.0, 0.001, -0.0123])
def test_a_constant_preview_changes_no_bit(curvature_per_m: float) -> None:
    horizon, other = ReferenceHorizon(KNOTS), ReferenceHorizon(KNOTS)
    turning = CurvaturePreview(2.0, 0.0, 0.001, 0.002, 0.003, 0.004)
    horizon.expand(PATH, CRUISING, curvature_per_m, turning)  # leaves nothing behind
    constant = CurvaturePreview(2.0, *[curvature_per_m] * 5)
    expected = other.expand(PATH, CRUISING, curvature_per_m)
    np.testing.assert_array_equal(
        horizon.expand(PATH, CRUISING, curvature_per_m, constant), expected
    )


@pytest.mark.parametrize("curvature_per_m", [0.004, 0.001])
def test_predicted_states_are_counted_from_the_road(curvature_per_m: float) -> None:
    """A car that is predicted on its reference has the errors of the path against the road."""
    preview = CurvaturePreview(2.5, 0.004, 0.003, 0.0, -0.003, -0.001)
    horizon = ReferenceHorizon(KNOTS)
    path = PATH._replace(c1=0.0, c2_per_m=0.0, c3_per_m2=0.0)
    on_path = horizon.expand(path, CRUISING, curvature_per_m, preview)
    found = horizon.counted_from_road(on_path)
    np.testing.assert_allclose(found[:, 4], path.c0_m, atol=1e-12)
    np.testing.assert_allclose(found[:, 5], 0.0, atol=1e-12)
    np.testing.assert_array_equal(found[:, :4], on_path[:, :4])


def test_after_a_delay_the_horizon_begins_so_many_stages_later() -> None:
    preview = CurvaturePreview(2.5, 0.004, 0.003, 0.0, -0.003, -0.001)
    later = ReferenceHorizon(KNOTS).expand(PATH, CRUISING, 0.001, preview, delay=3)
    np.testing.assert_allclose(
        later,
        ReferenceHorizon(place_knots(23, 23)).expand(PATH, CRUISING, 0.001, preview)[3:],
        rtol=1e-12,
    )
