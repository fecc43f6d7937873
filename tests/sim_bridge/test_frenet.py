"""The road frame against closed-form geometry."""

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from sim_bridge import frenet
from sim_bridge.scenario.table import constant

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
