"""The kinematic relations against a fine integration of the road frame."""

from math import cos, sin

import pytest

from rt_controller.contract.kinematics import (
    farthest_m,
    heading_change_rad,
    lateral_change_m,
    progress_m,
    speed_of,
)
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S

CURVATURE_PER_M = 0.004


def finely(before: VehicleState, now: VehicleState, steps: int = 2000) -> tuple[float, ...]:
    """(progress, e_y, e_psi) after a period in which the motion changes linearly."""
    s_m, ey_m, epsi_rad = 0.0, before.ey_m, before.epsi_rad
    for k in range(steps):
        w = (k + 0.5) / steps
        vx, vy, r = (a + w * (b - a) for a, b in zip(before[:3], now[:3], strict=True))
        along = (vx * cos(epsi_rad) - vy * sin(epsi_rad)) / (1.0 - CURVATURE_PER_M * ey_m)
        s_m += along * PERIOD_S / steps
        ey_m += (vx * sin(epsi_rad) + vy * cos(epsi_rad)) * PERIOD_S / steps
        epsi_rad += (r - CURVATURE_PER_M * along) * PERIOD_S / steps
    return s_m, ey_m, epsi_rad


def test_progress_heading_and_lateral_error_follow_from_the_motion() -> None:
    before = VehicleState(20.0, 0.3, 0.2, 0.0, 1.5, 0.08)
    now = VehicleState(20.2, 0.25, 0.26, 0.0, 0.0, 0.0)
    s_m, ey_m, epsi_rad = finely(before, now)
    now = now._replace(ds_m=s_m, ey_m=ey_m, epsi_rad=epsi_rad)
    assert progress_m(before, now, CURVATURE_PER_M) == pytest.approx(s_m, abs=2e-4)
    turned = heading_change_rad(before, now, CURVATURE_PER_M, s_m)
    assert before.epsi_rad + turned == pytest.approx(epsi_rad, abs=1e-6)
    assert before.ey_m + lateral_change_m(before, now) == pytest.approx(ey_m, abs=1e-4)


def test_the_progress_is_finite_beyond_the_centre_of_the_bend() -> None:
    state = VehicleState(10.0, 0.0, 0.0, 0.0, 300.0, 0.0)
    assert progress_m(state, state, CURVATURE_PER_M) == pytest.approx(10.0 * PERIOD_S / 0.05)


@pytest.mark.parametrize(
    ("before", "now", "curvature_per_m", "expected_m"),
    [
        # a mean of 12 m/s along, and 1 m/s to the left, at an angle of 0.1 rad
        ((10.0, 0.5), (14.0, 1.5), 0.0, 0.025 * (12.0 * cos(0.1) - 1.0 * sin(0.1))),
        ((10.0, 0.5), (14.0, 1.5), 0.02, 0.025 * (12.0 * cos(0.1) - 1.0 * sin(0.1)) / 0.96),
    ],
)
def test_the_progress_is_that_of_the_mean_velocities(
    before: tuple[float, float], now: tuple[float, float], curvature_per_m: float, expected_m: float
) -> None:
    states = [VehicleState(*each, 0.0, 0.0, 2.0, 0.1) for each in (before, now)]
    assert progress_m(states[0], states[1], curvature_per_m) == pytest.approx(expected_m)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_farthest_distance_is_where_the_car_turns_back(side: float) -> None:
    assert farthest_m(side * 0.5, 0.0) == 0.5
    assert farthest_m(side * 0.5, side * 2.0) == pytest.approx(0.5 + 0.4 + 0.5)
    assert farthest_m(side * 0.5, side * -0.5) == 0.5  # it has not crossed the path
    assert farthest_m(side * 0.1, side * -2.0) == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("vx_mps", "vy_mps", "speed_mps"),
    [(0.1, 0.9, 0.1), (-0.2, -0.9, -0.2), (0.0, 8.0, 8.0), (0.0, -8.0, 8.0), (3.0, 4.0, 5.0)],
)
def test_a_car_that_slides_sideways_is_not_at_rest(
    vx_mps: float, vy_mps: float, speed_mps: float
) -> None:
    state = VehicleState(vx_mps, vy_mps, 0.0, 0.0, 0.0, 0.0)
    assert speed_of(state) == pytest.approx(speed_mps)
