"""The road frame against closed-form geometry, and roads: what the car is told of them."""

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from sim_bridge import frenet
from sim_bridge.scenario.road import CourseOfBends, Road
from sim_bridge.scenario.table import Interpolation, constant, through

STEP_S = 0.001
STEPS = 25
START = np.array((20.0, 0.0, 0.0))


def constant_motion(vx: float, vy: float, yaw_rate: float, n_steps: int) -> Array:
    return np.tile((vx, vy, yaw_rate), (n_steps + 1, 1))


def wandering_motion(seed: int, n_steps: int) -> Array:
    steps = np.random.default_rng(seed).normal(0.0, (0.02, 0.02, 0.003), (n_steps + 1, 3))
    return START + np.cumsum(steps, axis=0)


def plane_track(vx: float, vy: float, yaw_rate: float, heading: float, t: Array) -> Array:
    """(x, y, heading) of a body from the origin under constant velocities in its own axes."""
    yaw = heading + yaw_rate * t
    if yaw_rate == 0.0:
        x = (vx * np.cos(yaw) - vy * np.sin(yaw)) * t
        y = (vx * np.sin(yaw) + vy * np.cos(yaw)) * t
    else:
        x = (vx * (np.sin(yaw) - np.sin(heading)) + vy * (np.cos(yaw) - np.cos(heading))) / yaw_rate
        y = (vy * (np.sin(yaw) - np.sin(heading)) - vx * (np.cos(yaw) - np.cos(heading))) / yaw_rate
    return np.column_stack((x, y, yaw))


@pytest.mark.parametrize("yaw_rate", [0.0, 0.2, -0.35])
def test_on_a_straight_road_the_pose_is_the_position_in_the_plane(yaw_rate: float) -> None:
    motion = constant_motion(22.0, -0.6, yaw_rate, 4000)
    poses = frenet.integrate_poses(motion, 0.0, 1.5, 0.1, STEPS, STEP_S)
    expected = plane_track(22.0, -0.6, yaw_rate, 0.1, np.arange(161) * STEPS * STEP_S)
    expected[:, 1] += 1.5
    np.testing.assert_allclose(poses, expected, atol=1e-9)


@pytest.mark.parametrize("curvature", [0.004, -0.004, 0.02])
@pytest.mark.parametrize("yaw_rate", [0.0, 0.15])
def test_on_a_circular_road_the_pose_is_in_polar_coordinates(
    curvature: float, yaw_rate: float
) -> None:
    ey0, epsi0, t = -1.2, 0.05, np.arange(81) * STEPS * STEP_S
    poses = frenet.integrate_poses(
        constant_motion(18.0, 0.4, yaw_rate, 2000), curvature, ey0, epsi0, STEPS, STEP_S
    )

    x, y, yaw = plane_track(18.0, 0.4, yaw_rate, epsi0, t).T
    y = y + ey0
    radius = 1.0 / curvature
    tangent = np.unwrap(np.arctan2(x / radius, (radius - y) / radius))
    distance = radius - np.sign(radius) * np.hypot(x, radius - y)
    np.testing.assert_allclose(poses[:, frenet.S], radius * tangent, atol=1e-8)
    np.testing.assert_allclose(poses[:, frenet.EY], distance, atol=1e-8)
    np.testing.assert_allclose(poses[:, frenet.EPSI], yaw - tangent, atol=1e-8)


def test_poses_advanced_by_periods_equal_poses_integrated_at_once() -> None:
    motion = wandering_motion(seed=4, n_steps=250)
    poses = frenet.integrate_poses(motion, -0.002, 0.3, 0.02, STEPS, STEP_S)
    pose = np.array((0.0, 0.3, 0.02))
    circle = constant(-0.002)
    for k in range(10):
        piece = motion[k * STEPS : (k + 1) * STEPS + 1]
        frenet.advance_along(piece[0], piece[1:], circle, STEP_S, pose)
        np.testing.assert_array_equal(pose, poses[k + 1])


def test_progress_stays_finite_beyond_the_centre_of_the_bend() -> None:
    poses = frenet.integrate_poses(
        constant_motion(20.0, 0.0, 0.0, 1000), 0.1, 9.9, 1.5, STEPS, STEP_S
    )
    assert np.all(np.isfinite(poses))


def drive_along(road: Road, speed_mps: float, seconds: float) -> np.ndarray:
    """(n, 3) poses of a body that turns exactly as the road does."""
    pose, poses, s_m = np.zeros(3), [], 0.0
    for _ in range(round(seconds / STEP_S)):
        before = road.curvature_per_m.at(s_m)
        after = road.curvature_per_m.at(s_m + speed_mps * STEP_S)
        frenet.advance_along(
            np.array([speed_mps, 0.0, speed_mps * before]),
            np.array([[speed_mps, 0.0, speed_mps * after]]),
            road.curvature_per_m,
            STEP_S,
            pose,
        )
        s_m += speed_mps * STEP_S
        poses.append(pose.copy())
    return np.array(poses)


def road(curvature) -> Road:
    return Road(curvature_per_m=curvature)


@pytest.mark.parametrize("interpolation", list(Interpolation))
def test_a_body_that_turns_with_the_road_stays_on_it(interpolation: Interpolation) -> None:
    curvature = through((0.0, 20.0, 50.0, 70.0), (0.0, 0.01, -0.008, 0.0), interpolation)
    poses = drive_along(road(curvature), 20.0, 4.0)
    assert poses[-1, frenet.S] == pytest.approx(80.0, abs=0.01)
    assert np.abs(poses[:, frenet.EY]).max() < 0.02
    assert np.abs(poses[:, frenet.EPSI]).max() < 2e-3


def test_the_compiled_curvature_is_that_of_the_table() -> None:
    """A car that does not turn loses heading by the curvature times its way."""
    curvature = through((3.0, 20.0, 50.0), (0.002, 0.01, -0.008), Interpolation.SPLINE)
    table = road(curvature).curvature_per_m
    ahead = np.array([[1.0, 0.0, 0.0]])
    for s_m in (-1.0, 3.0, 11.7, 20.0, 49.999, 50.0, 200.0):
        pose = np.array([s_m, 0.0, 0.0])
        frenet.advance_along(ahead[0], ahead, table, 1e-6, pose)
        assert -pose[frenet.EPSI] / 1e-6 == pytest.approx(curvature.at(s_m), abs=1e-8)


def test_the_ground_at_the_car_has_all_quantities() -> None:
    content = {
        "curvature_per_m": {"s_m": [0.0, 100.0], "value": [0.0, 0.01]},
        "friction_left": 0.9,
        "friction_right": {"s_m": [0.0, 10.0], "value": [0.9, 0.3], "interpolation": "step"},
        "bank_deg": 2.0,
        "grade_percent": 5.0,
    }
    ground = Road.model_validate(content).at(50.0, tail_wind_mps=-2.0, cross_wind_mps=4.0)
    expected = (0.005, 0.0001, 0.9, 0.3, np.radians(2.0), np.arctan(0.05), -2.0, 4.0)
    assert ground == pytest.approx(expected)


def test_a_bend_of_a_course_turns_by_its_angle() -> None:
    bends = [
        {"straight_m": 50.0, "radius_m": 80.0, "turn_deg": -90.0, "spiral_m": 30.0},
        {"straight_m": 20.0, "radius_m": 100.0, "turn_deg": 40.0},
    ]
    table = CourseOfBends.model_validate({"kind": "course", "bends": bends}).table()
    s_m = np.linspace(0.0, 400.0, 400_001)
    turned = np.cumsum(table(s_m)) * (s_m[1] - s_m[0])
    assert turned[-1] == pytest.approx(np.radians(-50.0), abs=1e-3)
    assert table.lowest().value == pytest.approx(-1.0 / 80.0)
    assert table.at(49.0) == table.at(399.0) == 0.0
