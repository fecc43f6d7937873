"""Random scenarios are driven to their end, or refused with the names of fields.

They are driven over the bus with the controller and the shipped linear model. A drive may end early
only where the scenario itself draws a fault.
"""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from random_scenarios import CONTENTS, Content, spoilt_contents, write_random_map

from rt_controller import Bundle, simulate
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import Mode
from rt_controller.loop import Ending
from sim_bridge.scenario import parse_scenario

FIELD = re.compile(
    r"(reference|initial|stops|road|duration_s|limits|faults)[\w.\[\]]*: expected .*, found "
)
LINE = re.compile(r"[a-z_0-9.\[\]]+: (expected .*, found |no such setting)", re.IGNORECASE)
TOO_DIFFICULT = {"TRACKING_LOST", "PATH_TOO_SHARP", "VEHICLE_BRAKING"}
"""why a drive without a fault may be stopped: a path that this car cannot follow on this road"""
OTHER_MOTION = {f"{signal}_IMPLAUSIBLE" for signal in ("SPEED", "LATERAL_SPEED", "YAW_RATE")}
LEAST_GRIP = 0.5
"""friction from which on no check fails without a fault; with less, a car does not brake or turn
as the linear model predicts"""
BUS_S = 3.0
"""part of a scenario that is driven"""


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_random_map(tmp_path_factory.mktemp("maps"))


@pytest.fixture(scope="module")
def lti() -> Bundle:
    return Bundle.load("lti")


def check_drive(content: Content, folder: Path, lti: Bundle) -> None:
    """Leaves the example where the content is refused; the refusal names a field."""
    scenario, refusal = None, ""
    try:
        scenario = parse_scenario(content, "random", folder)
    except ConfigError as error:
        refusal = str(error)
    assert scenario or FIELD.search(refusal), refusal
    assume(scenario)
    driven = simulate(replace(scenario, duration_s=min(scenario.duration_s, BUS_S)), model=lti)
    if driven.ending == Ending.MISSION_OVER.value:
        return
    if driven.ending == Ending.REFUSED.value:
        assert driven.stop_cause == "NOT_ENGAGED"
        return
    assert driven.ending == Ending.SAFE_STOPPED.value
    stopped = driven.modes.index(Mode.SAFE_STOP)
    if not any(fault.ticks.start <= stopped for fault in scenario.faults):
        road = scenario.road
        grip = min(road.friction_left.lowest().value, road.friction_right.lowest().value)
        slides = grip < LEAST_GRIP and driven.stop_cause in OTHER_MOTION
        assert slides or driven.stop_cause in TOO_DIFFICULT


def check_refusal(content: Content, folder: Path) -> None:
    """A content with junk is refused by a line for a field, or it is valid all the same."""
    try:
        parse_scenario(content, "random", folder)
    except ConfigError as error:
        for line in str(error).removeprefix("random:").strip().splitlines():
            assert LINE.match(line.strip().removeprefix(f"{folder}/")), line


@settings(max_examples=12, deadline=None, derandomize=True)
@given(content=CONTENTS)
def test_a_random_valid_scenario_is_driven_to_its_end(
    content: Content, maps: Path, lti: Bundle
) -> None:
    check_drive(content, maps, lti)


@pytest.mark.nightly
@settings(max_examples=1000, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(content=CONTENTS)
def test_a_thousand_random_valid_scenarios_are_driven_to_their_end(
    content: Content, maps: Path, lti: Bundle
) -> None:
    check_drive(content, maps, lti)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(content=spoilt_contents())
def test_a_spoilt_scenario_is_refused_with_the_names_of_its_fields(
    content: Content, maps: Path
) -> None:
    check_refusal(content, maps)


@pytest.mark.nightly
@settings(max_examples=3000, deadline=None)
@given(content=spoilt_contents())
def test_thousands_of_spoilt_scenarios_are_refused_with_names(content: Content, maps: Path) -> None:
    check_refusal(content, maps)
