"""The wanted lateral position: sines, tables, and the cubic that is sent."""

import numpy as np
import pytest

from rt_controller.contract.preview import REACH_S
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario.lateral import Sine
from sim_bridge.scenario.loading import parse_scenario

NEAR_S = 0.4 * REACH_S


def test_a_sine_begins_and_ends_without_a_step_of_heading() -> None:
    sine = Sine(kind="sine", amplitude_m=0.5, frequency_hz=0.5, start_t_s=1.0, periods=6.0)
    time_s = np.arange(0.0, 16.0, 1e-3)
    ey_m = sine.lateral().law(time_s)
    slope = np.gradient(ey_m, time_s)
    assert np.abs(ey_m[(time_s < 1.0) | (time_s > 13.0)]).max() == 0.0
    assert np.abs(np.diff(slope)).max() < 0.01
    assert ey_m.max() == pytest.approx(0.5, abs=1e-6)


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


def test_a_slower_car_has_the_same_path_on_the_road() -> None:
    drive = load_scenario("sine_60")
    in_time = drive.path_ahead(100.0, 60.0 / 3.6, 6.0)
    late = drive.path_ahead(100.0, 60.0 / 3.6, 9.0)
    slow = drive.path_ahead(100.0, 2.0, 9.0)
    assert late == in_time
    assert (slow.c0_m, slow.c1) == pytest.approx((in_time.c0_m, in_time.c1), abs=0.02)
    beyond = drive.path_ahead(60.0 / 3.6 * drive.duration_s + 1.0, 60.0 / 3.6, drive.duration_s)
    assert beyond.c1 != 0.0


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
