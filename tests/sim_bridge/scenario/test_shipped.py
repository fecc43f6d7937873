"""The shipped scenarios, each driven with the own car and a plain driver."""

import numpy as np
import pytest
from reference_driver import drive

from sim_bridge.scenario import Scenario, load_scenario, shipped_scenarios
from sim_bridge.scenario.nominal_drive import drive_nominally

NAMES = {
    "corner", "curvature_step", "double_lane_change", "iso_3888_1", "iso_3888_2", "lane_change_120",
    "lane_change_60", "launch_50", "road_course", "sine_110", "sine_60", "slalom",
    "split_friction", "stop_and_go", "stop_and_hold", "straight", "u_turn",
}  # fmt: skip


def peak_lateral_mps2(scenario: Scenario) -> float:
    """The largest lateral acceleration of the drive if it follows the reference exactly."""
    drive = drive_nominally(scenario)
    bend = np.gradient(np.gradient(drive.ey_m, drive.s_m), drive.s_m)
    curvature = scenario.road.curvature_per_m(drive.s_m)
    return float(np.max(np.abs(bend + curvature) * drive.speed_mps**2))


def test_the_shipped_scenarios_are_these() -> None:
    assert set(shipped_scenarios()) == NAMES


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_shipped_scenario_stays_within_the_grip_of_its_road(name: str) -> None:
    scenario = load_scenario(name)
    friction = min(scenario.road.friction_left.lowest().value, 0.85)
    assert peak_lateral_mps2(scenario) < 0.8 * 9.81 * friction


@pytest.mark.parametrize("name", sorted(NAMES - {"road_course", "stop_and_go", "corner", "u_turn"}))
def test_a_plain_driver_follows_every_shipped_scenario(name: str) -> None:
    scenario = load_scenario(name)
    metrics = drive(scenario).metrics
    assert metrics.ey_peak_m < 0.6
    assert metrics.speed_peak_mps < 1.5
    if scenario.stops:
        assert metrics.stops_missed == 0.0
        assert metrics.stop_error_m < 0.2
        assert metrics.creep_m < 0.02
