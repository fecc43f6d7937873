"""Roads: what the car is told of them, and the road frame on a road that bends."""

import numpy as np
import pytest

from rt_controller.contract.preview import REACH_S
from sim_bridge import frenet
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario.road import CourseOfBends, Road
from sim_bridge.scenario.table import Interpolation, through

STEP_S = 0.001


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


def test_the_curvature_ahead_is_sent_as_far_as_the_path() -> None:
    scenario = load_scenario("curvature_step")
    speed_mps = 80.0 / 3.6
    straight = scenario.preview_ahead(30.0, speed_mps, speed_mps)
    assert straight == pytest.approx((REACH_S * speed_mps / 4.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    half_way = scenario.preview_ahead(60.0 - 2.0 * straight.spacing_m, speed_mps, speed_mps)
    assert half_way[1:] == pytest.approx((0.0, 0.0, 0.0015, 0.003, 0.003), abs=8e-4)
    beyond = scenario.preview_ahead(60.1, speed_mps, speed_mps)
    assert beyond[1:] == pytest.approx([0.003] * 5)
    assert scenario.preview_ahead(0.0, 0.0, 0.0).spacing_m == 1.0
    assert scenario.preview_ahead(0.0, 10.0, 0.0) == scenario.preview_ahead(0.0, 0.0, 10.0)
