"""What a scenario wants: tables, speeds, stops, lateral positions, and the path that is sent."""

from itertools import pairwise
from math import sqrt

import numpy as np
import pytest

from rt_controller.contract.preview import REACH_S
from sim_bridge.scenario import Scenario, load_scenario, parse_scenario
from sim_bridge.scenario.speed import (
    START,
    CurveSpeed,
    Progress,
    Stop,
    constant_speed,
    next_progress,
    reference_speed,
)
from sim_bridge.scenario.table import Interpolation, Table, constant, joined, through

X, Y = (0.0, 10.0, 15.0, 40.0), (1.0, 3.0, -2.0, 0.5)
PLACES = np.linspace(-5.0, 50.0, 400)


@pytest.mark.parametrize("interpolation", list(Interpolation))
def test_a_table_has_its_knots_slopes_extremes_and_its_mirror(interpolation: Interpolation) -> None:
    table = through(X, Y, interpolation)
    np.testing.assert_allclose(table(np.array(X)), Y, atol=1e-12)
    assert table.at(-3.0) == pytest.approx(Y[0])
    assert table.at(100.0) == pytest.approx(Y[-1])
    assert [table.at(x) for x in PLACES] == pytest.approx(table(PLACES).tolist())
    for x in (1.0, 7.3, 12.0, 33.3):
        found = (table.at(x + 1e-5) - table.at(x - 1e-5)) / 2e-5
        assert table.slope_at(x) == pytest.approx(found, abs=1e-6)
    values = table(np.linspace(0.0, 40.0, 40_001))
    assert table.lowest().value == pytest.approx(values.min(), abs=1e-5)
    assert table.highest().value == pytest.approx(values.max(), abs=1e-5)
    assert table.at(table.highest().x) == pytest.approx(table.highest().value)
    inside = np.linspace(0.01, 29.99, 200)
    np.testing.assert_allclose(table.backwards(30.0)(30.0 - inside), table(inside), atol=1e-9)


def test_joined_tables_follow_each_other() -> None:
    tables: list[Table] = [through(X, Y), constant(7.0), through((0.0, 5.0), (1.0, 2.0))]
    table = joined(tables, [12.0, 3.0, 5.0])
    found = [table.at(x) for x in (5.0, 11.9, 13.0, 17.5, 30.0)]
    assert found == pytest.approx([2.0, tables[0].at(11.9), 7.0, 1.5, 2.0])


STOP = Stop(at_s_m=100.0, hold_s=3.0, deceleration_mps2=2.0, acceleration_mps2=1.5)


def scenario(speed: object, **parts: object) -> Scenario:
    content = {"format": 2, "name": "x", "duration_s": 60.0, "reference": {"speed_kmh": speed}}
    return parse_scenario(content | parts, "test")


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
    profile = wanted.profile(curvature, 600.0)
    speeds = [profile.at(float(s), 0.0) for s in range(600)]
    assert speeds[200] == pytest.approx(20.0)
    for before, after in pairwise(speeds):
        assert -2.0 - 1e-9 <= 0.5 * (after**2 - before**2) <= 1.5 + 1e-9
    assert max(speeds) == pytest.approx(30.0)


def test_a_speed_over_distance_that_ends_with_zero_is_a_stop() -> None:
    drive = scenario({"s_m": [0.0, 50.0, 90.0], "value": [72.0, 72.0, 0.0]})
    (stop,) = drive.all_stops
    assert stop.at_s_m == 90.0
    assert stop.deceleration_mps2 == pytest.approx(5.0)
    slow = scenario({"s_m": [0.0, 80.0, 100.0], "value": [60.0, 20.0, 0.0]})
    for s_m in (0.0, 40.0, 80.0, 95.0):
        assert slow.reference_speed_mps(s_m, 0.0) == pytest.approx(slow.speed.at(s_m, 0.0))
    held = next_progress(START, drive.all_stops, 89.8, 0.0, 9.0)
    assert drive.reference_speed_mps(89.8, 9.1, held) == 0.0


NEAR_S = 0.4 * REACH_S


@pytest.mark.parametrize("name", ["sine_60", "sine_110"])
def test_the_shipped_sines_are_half_a_metre_at_half_a_hertz(name: str) -> None:
    drive = load_scenario(name)
    time_s = np.arange(4.0, 14.0, 1e-3)
    ey_m = drive.ey_m(drive.start.speed_mps * time_s, time_s)
    np.testing.assert_allclose(ey_m, 0.5 * np.sin(np.pi * (time_s - 1.0)), atol=1e-9)


@pytest.mark.parametrize("name", ["sine_110", "iso_3888_1", "double_lane_change"])
def test_the_cubic_is_exact_at_the_car_and_close_over_the_preview(name: str) -> None:
    drive = load_scenario(name)
    speed_mps = drive.start.speed_mps
    ahead_s = np.linspace(0.0, REACH_S, 30)
    for time_s in np.arange(0.0, 10.0, 0.13):
        s_m = speed_mps * time_s
        path = drive.path_ahead(s_m, speed_mps, time_s)
        sigma = speed_mps * ahead_s
        cubic = path.c0_m + sigma * (path.c1 + sigma * (path.c2_per_m + sigma * path.c3_per_m2))
        wanted = drive.ey_m(s_m + sigma, time_s + ahead_s)
        assert path.c0_m == pytest.approx(wanted[0])
        # What is near is driven first; by what is far the path is sent again.
        is_near = ahead_s <= NEAR_S
        np.testing.assert_allclose(cubic[is_near], wanted[is_near], atol=0.02)
        np.testing.assert_allclose(cubic, wanted, atol=0.4)


@pytest.mark.parametrize("name", ["sine_110", "iso_3888_1", "double_lane_change"])
def test_cubic_and_curvature_ahead_together_are_close_over_the_preview(name: str) -> None:
    drive = load_scenario(name)
    speed_mps = drive.start.speed_mps
    ahead_m = speed_mps * np.linspace(0.0, REACH_S, 331)
    for time_s in np.arange(1.1, 10.0, 0.13):
        s_m = speed_mps * time_s
        path = drive.path_ahead(s_m, speed_mps, time_s)
        ahead = drive.preview_ahead(s_m, speed_mps, speed_mps, time_s)
        spacings = ahead.spacing_m * np.arange(5)
        lacking = np.interp(
            ahead_m, spacings, np.subtract(ahead[1:], drive.road.curvature_per_m.at(s_m))
        )
        slope = np.cumsum(lacking) * ahead_m[1]
        found = np.polyval(path[3::-1], ahead_m) + np.cumsum(slope) * ahead_m[1]
        wanted = drive.ey_m(s_m + ahead_m, time_s + ahead_m / speed_mps)
        np.testing.assert_allclose(found, wanted, atol=0.1)


def test_a_path_over_time_changes_where_the_nominal_drive_is_at_its_times() -> None:
    knots = {"t_s": [0.0, 4.0, 8.0], "value": [0.0, 0.0, 0.5], "interpolation": "pchip"}
    speed = {"t_s": [0.0, 10.0], "value": [36.0, 72.0]}
    raw = {"format": 2, "name": "x", "duration_s": 10.0}
    drive = parse_scenario({**raw, "reference": {"speed_kmh": speed, "ey_m": knots}}, "x")
    ends_m = np.array([4.0 * 10.0 + 0.5 * 16.0, 8.0 * 10.0 + 0.5 * 64.0])
    assert drive.ey_m(ends_m) == pytest.approx([0.0, 0.5], abs=1e-3)


def test_the_double_lane_change_is_that_of_the_paper() -> None:
    scenario = load_scenario("double_lane_change")
    assert scenario.start.speed_mps == pytest.approx(80 / 3.6)
    assert scenario.road.curvature_per_m.at(50.0) == 0.001
    assert scenario.ticks == 400
    lateral = scenario.ey_m(np.linspace(0.0, 220.0, 500))
    assert lateral.max() == pytest.approx(3.5)
    assert lateral[0] == lateral[-1] == 0.0


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
