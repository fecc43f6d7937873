"""The wanted speed: profiles, stops with a hold, and what is sent about them."""

from itertools import pairwise
from math import sqrt

import pytest

from sim_bridge.scenario import Scenario, parse_scenario
from sim_bridge.scenario.speed import (
    START,
    CurveSpeed,
    Progress,
    Stop,
    constant_speed,
    next_progress,
    reference_speed,
)
from sim_bridge.scenario.table import Interpolation, through

STOP = Stop(at_s_m=100.0, hold_s=3.0, deceleration_mps2=2.0, acceleration_mps2=1.5)


def scenario(speed: object, **parts: object) -> Scenario:
    content = {"format": 2, "name": "x", "duration_s": 60.0, "reference": {"speed_kmh": speed}}
    return parse_scenario(content | parts, "test")


def test_before_a_stop_the_speed_falls_with_its_deceleration() -> None:
    profile = constant_speed(20.0)
    assert reference_speed(profile, [STOP], START, 0.0, 0.0) == pytest.approx(20.0)
    assert reference_speed(profile, [STOP], START, 84.0, 0.0) == pytest.approx(8.0)
    assert reference_speed(profile, [STOP], START, 101.0, 0.0) == 0.0


def test_a_car_that_stands_near_its_target_is_held_and_released() -> None:
    stops = [STOP]
    assert next_progress(START, stops, 99.0, 0.0, 5.0) == START
    assert next_progress(START, stops, 99.9, 0.5, 5.0) == START
    held = next_progress(START, stops, 99.9, 0.05, 5.0)
    assert held.is_holding
    assert reference_speed(constant_speed(20.0), stops, held, 99.9, 6.0) == 0.0
    assert next_progress(held, stops, 99.9, 0.0, 7.9) == held
    released = next_progress(held, stops, 99.9, 0.0, 8.0)
    assert released == Progress(1, None, 8.0)
    assert reference_speed(constant_speed(20.0), stops, released, 99.9, 10.0) == pytest.approx(3.0)


def test_the_path_carries_deceleration_hold_and_start() -> None:
    drive = scenario(72.0, stops=[{"at_s_m": 100.0, "hold_s": 3.0, "deceleration_mps2": 2.5}])
    path = drive.path_ahead(60.0, 14.0, 5.0)
    assert path.v_mps == pytest.approx(sqrt(2.0 * 2.5 * 40.0))
    assert path.a_mps2 == pytest.approx(-2.5, abs=0.05)
    holding = Progress(0, 9.0, None)
    assert drive.path_ahead(100.0, 0.0, 10.0, holding)[4:] == (0.0, 0.0)
    start = drive.path_ahead(100.0, 0.0, 12.0, Progress(1, None, 12.0))
    assert start.v_mps == 0.0
    assert start.a_mps2 == pytest.approx(2.0)


def test_the_path_carries_the_slope_of_a_speed_over_time() -> None:
    drive = scenario({"t_s": [0.0, 2.0, 12.0], "value": [0.0, 0.0, 36.0]})
    assert drive.path_ahead(0.0, 0.0, 0.5)[4:] == (0.0, 0.0)
    path = drive.path_ahead(5.0, 3.0, 5.0)
    assert path.v_mps == pytest.approx(3.0)
    assert path.a_mps2 == pytest.approx(1.0)


def test_a_drive_with_stops_that_begins_at_rest_accelerates_as_after_a_stop() -> None:
    drive = scenario(50.0, initial={"speed_kmh": 0.0}, stops=[{"at_s_m": 80.0, "hold_s": 1.0}])
    assert drive.reference_speed_mps(0.0, 0.0) == 0.0
    assert drive.reference_speed_mps(0.0, 1.0) == pytest.approx(2.0)
    assert scenario(80.0).path_ahead(3.0, 20.0)[4:] == (80.0 / 3.6, 0.0)


def test_the_speed_for_bends_keeps_all_three_accelerations() -> None:
    curvature = through((0.0, 150.0, 250.0), (0.0, 0.01, 0.0), Interpolation.STEP)
    wanted = CurveSpeed(
        kind="curve_speed", max_kmh=108.0, lateral_mps2=4.0, acceleration_mps2=1.5,
        deceleration_mps2=2.0,
    )  # fmt: skip
    profile = wanted.on_road(curvature, 600.0)
    speeds = [profile.at(float(s), 0.0) for s in range(600)]
    assert speeds[200] == pytest.approx(20.0)
    for before, after in pairwise(speeds):
        assert -2.0 - 1e-9 <= 0.5 * (after**2 - before**2) <= 1.5 + 1e-9
    assert max(speeds) == pytest.approx(30.0)


def test_a_speed_over_distance_that_ends_with_zero_is_a_stop() -> None:
    drive = scenario({"s_m": [0.0, 50.0, 90.0], "value": [72.0, 72.0, 0.0]})
    (stop,) = drive.stops
    assert stop.at_s_m == 90.0
    assert stop.deceleration_mps2 == pytest.approx(5.0)
    slow = scenario({"s_m": [0.0, 80.0, 100.0], "value": [60.0, 20.0, 0.0]})
    for s_m in (0.0, 40.0, 80.0, 95.0):
        assert slow.reference_speed_mps(s_m, 0.0) == pytest.approx(slow.speed.at(s_m, 0.0))
    held = next_progress(START, drive.stops, 89.8, 0.0, 9.0)
    assert drive.reference_speed_mps(89.8, 9.1, held) == 0.0
