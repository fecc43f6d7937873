"""The shipped scenarios demand no more than their roads carry."""

import numpy as np
import pytest

from sim_bridge.scenario import Scenario, load_scenario, shipped_scenarios
from sim_bridge.scenario.nominal_drive import drive_nominally


def peak_lateral_mps2(scenario: Scenario) -> float:
    """The largest lateral acceleration of the drive if it follows the reference exactly."""
    drive = drive_nominally(scenario)
    bend = np.gradient(np.gradient(drive.ey_m, drive.s_m), drive.s_m)
    curvature = scenario.road.curvature_per_m(drive.s_m)
    return float(np.max(np.abs(bend + curvature) * drive.speed_mps**2))


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_stays_within_the_grip_of_its_road(name: str) -> None:
    scenario = load_scenario(name)
    friction = min(scenario.road.friction_left.lowest().value, 0.85)
    assert peak_lateral_mps2(scenario) < 0.8 * 9.81 * friction
