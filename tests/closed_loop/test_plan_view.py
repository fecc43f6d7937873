"""A drive in the plane: where its car, road and predictions are."""

from dataclasses import replace

import numpy as np
import pytest

from rt_controller import simulate
from rt_controller.drive.plan_view import corners, plan_view
from sim_bridge.scenario.loading import parse_scenario

RADIUS_M = 40.0


@pytest.fixture(scope="module")
def bend():
    content = {
        "format": 2, "name": "circle", "duration_s": 4.0,
        "road": {"curvature_per_m": 1.0 / RADIUS_M},
        "reference": {"speed_kmh": 40.0},
    }  # fmt: skip
    return simulate(parse_scenario(content, "circle"))


def test_a_car_on_a_circular_road_drives_a_circle(bend):
    car = plan_view(bend).car
    away_m = np.hypot(car.x_m, car.y_m - RADIUS_M)
    np.testing.assert_allclose(away_m, RADIUS_M - bend.poses[:, 1], atol=1e-3)
    assert car.y_m[-1] > 10.0
    # The heading of the car is the direction in which it moves, but for its sideslip.
    moved = np.unwrap(np.arctan2(np.diff(car.y_m), np.diff(car.x_m))[10:])
    np.testing.assert_allclose(car.yaw_rad[11:], moved, atol=0.06)


def test_a_simulated_car_is_where_it_is_and_not_where_it_was_received(bend):
    wrong = bend.values.copy()
    wrong[:, bend.columns.index("ey_m")] += 1.0
    shifted = replace(bend, values=wrong)
    assert plan_view(shifted).car.y_m == pytest.approx(plan_view(bend).car.y_m)
    received = plan_view(replace(shifted, true_poses=None))
    assert received.car.y_m[0] == pytest.approx(plan_view(bend).car.y_m[0] + 1.0, abs=0.01)


def test_without_a_scenario_the_road_is_the_curvature_that_was_received(bend):
    known, received = plan_view(bend), plan_view(replace(bend, scenario=None))
    at_end = [(view.car.x_m[-1], view.car.y_m[-1]) for view in (known, received)]
    assert at_end[1] == pytest.approx(at_end[0], abs=0.3)


def test_predictions_begin_after_the_delay_on_the_way_that_the_car_then_drives(bend):
    view = plan_view(bend)
    driven = [tick for tick in view.horizons if 40 <= tick < len(bend) - 60]
    assert len(driven) >= 10
    for tick in driven:
        horizon, later = view.horizons[tick], slice(tick + 2, tick + 43)
        away_m = np.hypot(horizon.x_m - view.car.x_m[later], horizon.y_m - view.car.y_m[later])
        assert away_m[0] < 0.05
        assert away_m.max() < 1.0


def test_the_outline_has_the_size_of_the_body(bend):
    front, rear = bend.body.front_m, bend.body.rear_m
    x_m, y_m = corners(plan_view(bend).car, 100, bend.body)
    ahead_m = np.hypot(x_m[2] - 0.5 * (x_m[0] + x_m[4]), y_m[2] - 0.5 * (y_m[0] + y_m[4]))
    assert ahead_m == pytest.approx(front + rear)
    assert np.hypot(x_m[4] - x_m[0], y_m[4] - y_m[0]) == pytest.approx(bend.body.width_m)
