"""Relations of the motion against a fine integration, and the order of the vectors."""

from math import atan, cos, radians, sin

import pytest

from rt_controller.contract.kinematics import (
    farthest_m,
    heading_change_rad,
    lateral_change_m,
    progress_m,
    speed_of,
)
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import (
    GRAVITY_MPS2,
    MOTION,
    PATH_STATES,
    VEHICLE,
    ControlInput,
    InputColumn,
    StateColumn,
    VehicleState,
)
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


def test_progress_heading_and_lateral_error_follow_from_the_motion():
    before = VehicleState(20.0, 0.3, 0.2, 0.0, 1.5, 0.08)
    now = VehicleState(20.2, 0.25, 0.26, 0.0, 0.0, 0.0)
    s_m, ey_m, epsi_rad = finely(before, now)
    now = now._replace(ds_m=s_m, ey_m=ey_m, epsi_rad=epsi_rad)
    assert progress_m(before, now, CURVATURE_PER_M) == pytest.approx(s_m, abs=2e-4)
    turned = heading_change_rad(before, now, CURVATURE_PER_M, s_m)
    assert before.epsi_rad + turned == pytest.approx(epsi_rad, abs=1e-6)
    assert before.ey_m + lateral_change_m(before, now) == pytest.approx(ey_m, abs=1e-4)


def test_the_progress_is_finite_beyond_the_centre_of_the_bend():
    state = VehicleState(10.0, 0.0, 0.0, 0.0, 300.0, 0.0)
    assert progress_m(state, state, CURVATURE_PER_M) == pytest.approx(10.0 * PERIOD_S / 0.05)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_farthest_distance_is_where_the_car_turns_back(side):
    assert farthest_m(side * 0.5, 0.0) == 0.5
    assert farthest_m(side * 0.5, side * 2.0) == pytest.approx(0.5 + 0.4 + 0.5)
    assert farthest_m(side * 0.5, side * -0.5) == 0.5  # it has not crossed the path
    assert farthest_m(side * 0.1, side * -2.0) == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("vx_mps", "vy_mps", "speed_mps"),
    [(0.1, 0.9, 0.1), (-0.2, -0.9, -0.2), (0.0, 8.0, 8.0), (0.0, -8.0, 8.0), (3.0, 4.0, 5.0)],
)
def test_a_car_that_slides_sideways_is_not_at_rest(vx_mps, vy_mps, speed_mps):
    state = VehicleState(vx_mps, vy_mps, 0.0, 0.0, 0.0, 0.0)
    assert speed_of(state) == pytest.approx(speed_mps)


CAR = SteeringGeometry(wheelbase_m=3.0, rear_axle_m=1.5, steering_ratio=16.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_wheel_of_a_steady_turn_is_that_of_the_radius_and_the_understeer(side):
    slow_rad = CAR.steady_wheel_rad(1.0, side * 0.1)
    assert slow_rad == pytest.approx(side * 16.0 * atan(0.3), rel=0.01)
    of_1_g = CAR.steady_wheel_rad(20.0, side * GRAVITY_MPS2 / 20.0)
    rolling_rad = atan(3.0 * GRAVITY_MPS2 / 400.0)
    assert of_1_g == pytest.approx(side * 16.0 * (rolling_rad + radians(1.43)))


def test_columns_have_the_order_of_the_vectors():
    assert tuple(column.name for column in StateColumn) == VehicleState._fields
    assert tuple(column.name for column in InputColumn) == ControlInput._fields
    assert [*StateColumn] == [*range(len(VehicleState._fields))]
    assert [*range(6)[MOTION], *range(6)[PATH_STATES]] == [*range(6)]
    assert VEHICLE.state_names == VehicleState._fields
