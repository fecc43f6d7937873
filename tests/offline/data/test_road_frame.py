"""Projection of poses onto a road equals integration along that road."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from offline.data.recording import Anchor, RoadPose, onto_road
from sim_bridge import frenet

STEP_S = 0.001
STEPS_PER_PERIOD = 25
PERIODS = 81

curvatures = st.one_of(
    st.sampled_from([0.0, -4e-3, 4e-3, 1e-9, -1e-9]), st.floats(-5e-3, 5e-3, allow_nan=False)
)
lateral_errors = st.floats(-2.0, 2.0)
heading_errors = st.floats(-0.175, 0.175)
seeds = st.integers(0, 2**31)
seeded = settings(max_examples=50, derandomize=True, deadline=None)


def a_drive(seed: int) -> NDArray[np.float64]:
    """(v_x, v_y, yaw rate) of two seconds of random motion on a fine grid."""
    rng = np.random.default_rng(seed)
    start = np.array([rng.uniform(8.0, 40.0), 0.0, rng.uniform(-0.2, 0.2)])
    steps = rng.normal(0.0, (0.01, 0.005, 0.002), (PERIODS * STEPS_PER_PERIOD + 1, 3))
    return start + np.cumsum(steps, axis=0)


def along(motion: NDArray[np.float64], curvature: float, ey: float, epsi: float):
    return frenet.integrate_poses(motion, curvature, ey, epsi, STEPS_PER_PERIOD, STEP_S)


def lay(pose: NDArray[np.float64], curvature: float, ey: float, epsi: float) -> RoadPose:
    return onto_road(pose[None], Anchor(*(np.array([v]) for v in (curvature, ey, epsi))))


def moved(pose: NDArray[np.float64], X: float, Y: float, angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    turned = np.stack([c * pose[:, 0] - s * pose[:, 1], s * pose[:, 0] + c * pose[:, 1]], axis=1)
    return np.column_stack([turned + (X, Y), pose[:, 2] + angle])


@seeded
@given(seeds, curvatures, lateral_errors, heading_errors)
def test_projection_onto_a_road_equals_integration_along_it(seed, curvature, ey, epsi):
    motion = a_drive(seed)
    on_plane = along(motion, 0.0, 0.0, 0.0)
    expected = along(motion, curvature, ey, epsi)
    found = np.stack([column[0] for column in lay(on_plane, curvature, ey, epsi)], axis=-1)
    np.testing.assert_allclose(found, expected, atol=1e-7)


@seeded
@given(seeds, curvatures, lateral_errors, heading_errors)
def test_the_first_pose_has_the_errors_of_the_anchor(seed, curvature, ey, epsi):
    pose = moved(along(a_drive(seed), 0.0, 0.0, 0.0), 310.0, -57.0, 2.0)
    first = [column[0, 0] for column in lay(pose, curvature, ey, epsi)]
    assert first[0] == 0.0
    assert first[1] == pytest.approx(ey, abs=1e-14)
    assert first[2] == epsi


@seeded
@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-7.0, 7.0))
def test_the_position_on_the_plane_does_not_change_the_path_states(X, Y, angle):
    pose = along(a_drive(5), 0.0, 0.0, 0.0)
    here, there = (lay(each, 3e-3, 0.8, -0.06) for each in (pose, moved(pose, X, Y, angle)))
    for one, other in zip(here, there, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_on_a_straight_road_the_path_states_are_the_plane_coordinates():
    pose = along(a_drive(1), 0.0, 0.0, 0.0)
    np.testing.assert_allclose(np.stack(lay(pose, 0.0, 0.0, 0.0), axis=-1)[0], pose, atol=1e-12)


@pytest.mark.parametrize("curvature", [4e-3, -4e-3])
def test_a_concentric_circle_has_a_constant_lateral_error(curvature):
    """Half a metre inside the curve, where the centre line is longer than the path."""
    ey = 0.5 * np.sign(curvature)
    radius, angle = 1.0 / curvature - ey, np.sign(curvature) * np.linspace(0.0, 1.2, 60)
    pose = np.column_stack([radius * np.sin(angle), radius * (1.0 - np.cos(angle)), angle])
    s, found_ey, epsi = (column[0] for column in lay(pose, curvature, float(ey), 0.0))
    np.testing.assert_allclose(s, angle / curvature, atol=1e-9)
    np.testing.assert_allclose(found_ey, ey, atol=1e-9)
    np.testing.assert_allclose(epsi, 0.0, atol=1e-12)


@seeded
@given(seeds, curvatures, lateral_errors, heading_errors)
def test_mirrored_poses_on_a_mirrored_road_give_mirrored_path_states(seed, curvature, ey, epsi):
    pose = along(a_drive(seed), 0.0, 0.0, 0.0)
    s, found_ey, found_epsi = lay(pose, curvature, ey, epsi)
    mirrored = lay(pose * (1.0, -1.0, -1.0), -curvature, -ey, -epsi)
    np.testing.assert_array_equal(mirrored.s_m, s)
    np.testing.assert_array_equal(mirrored.ey_m, -found_ey)
    np.testing.assert_array_equal(mirrored.epsi_rad, -found_epsi)


def test_each_trajectory_has_its_own_road():
    poses = np.stack([along(a_drive(seed), 0.0, 0.0, 0.0) for seed in (1, 2, 3)])
    anchor = Anchor(np.array([-4e-3, 0.0, 2e-3]), np.array([1.0, -2.0, 0.0]), np.zeros(3))
    together = onto_road(poses, anchor)
    for i in range(3):
        alone = lay(poses[i], *(float(column[i]) for column in anchor))
        for one, other in zip(together, alone, strict=True):
            np.testing.assert_array_equal(one[i], other[0])
