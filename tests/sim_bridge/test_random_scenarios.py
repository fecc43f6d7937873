"""Random scenarios are driven to their end, or refused with the names of fields.

They are the shipped ones and the examples of the guide with other numbers, driven over the bus with
the controller and the shipped linear model. A drive may end early only where the scenario itself
draws a fault.
"""

import re
import tomllib
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from datetime import datetime
from importlib import resources
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

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


Content = dict[str, Any]
GUIDE = (Path(__file__).parents[2] / "docs" / "scenarios.md").read_text(encoding="utf-8")
FILES = (resources.files("sim_bridge") / "scenarios").iterdir()
CONTENTS: list[Content] = [
    tomllib.loads(text)
    for text in (
        *sorted(file.read_text("utf-8") for file in FILES if file.name.endswith(".toml")),
        *re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL),
    )
    if "opendrive" not in text
]
JUNK = (
    None, True, "fast", "", [], {}, [1.0], [1.0, "x"], {"kind": "sine"}, {"kind": 3}, -1, 0,
    1e300, -1e300, 1e-300, float("nan"), float("inf"), 10**400, datetime(2025, 1, 1),
    {"s_m": [], "value": []}, {"s_m": [0.0], "value": ["x"]}, {"s_m": 1.0, "value": 2.0},
    {"s_m": [0.0, 1e-9], "value": [0.0, 1.0]}, {"s_m": [0.0, 1e-9], "value": [5.0, 9.0]},
    {"t_s": [0.0, 1e12], "value": [5.0, 9.0], "interpolation": "spline"},
    {"s_m": [-1e9, 1e9], "value": [0.1, 0.2], "interpolation": "pchip"},
    {"kind": "course", "bends": [{"radius_m": 1e12, "turn_deg": 9.0}]},
    {"kind": "moves", "moves": []},
    {"kind": "sine", "amplitude_m": 0.5, "wavelength_m": 1e-6},
    {"kind": "slalom", "start_s_m": 0.0, "spacing_m": 36.0, "cones": 100},
    {"kind": "iso_3888_2", "start_s_m": 1e6},
)  # fmt: skip


def leaves(table: Any) -> Iterator[tuple[Any, Any]]:
    """(table or list, key) of each value inside that is neither."""
    for key, part in list(table.items() if isinstance(table, dict) else enumerate(table)):
        if isinstance(part, dict | list):
            yield from leaves(part)
        else:
            yield table, key


@st.composite
def contents(draw: st.DrawFn) -> Content:
    """A third of the numbers are up to 40 % smaller or larger."""
    content = deepcopy(draw(st.sampled_from(CONTENTS)))
    rng = Random(draw(st.integers(0, 2**32)))
    for table, key in leaves(content):
        if key != "format" and type(table[key]) in (int, float) and rng.random() < 0.3:
            table[key] = type(table[key])(table[key] * rng.uniform(0.6, 1.4))
    return content


@st.composite
def spoilt_contents(draw: st.DrawFn) -> Content:
    """A content with junk in some places, or with a field that does not exist."""
    content = draw(contents())
    for _ in range(draw(st.integers(1, 2))):
        table, key = draw(st.sampled_from(list(leaves(content))))
        is_new = isinstance(table, dict) and draw(st.integers(0, 5)) == 0
        table["unknown" if is_new else key] = deepcopy(draw(st.sampled_from(JUNK)))
    for part in draw(st.sets(st.sampled_from(sorted(content)), max_size=1)):
        content[part] = deepcopy(draw(st.sampled_from(JUNK)))
    return content


@pytest.fixture(scope="module")
def lti() -> Bundle:
    return Bundle.load("lti")


def check_drive(content: Content, lti: Bundle) -> None:
    """Leaves the example where the content is refused; the refusal names a field."""
    scenario, refusal = None, ""
    try:
        scenario = parse_scenario(content, "random")
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


def check_refusal(content: Content) -> None:
    """A content with junk is refused by a line for a field, or it is valid all the same."""
    try:
        parse_scenario(content, "random")
    except ConfigError as error:
        for line in str(error).removeprefix("random:").strip().splitlines():
            assert LINE.match(line.strip()), line


@settings(max_examples=6, deadline=None, derandomize=True)
@given(content=contents())
def test_a_random_valid_scenario_is_driven_to_its_end(content: Content, lti: Bundle) -> None:
    check_drive(content, lti)


@pytest.mark.nightly
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(content=contents())
def test_many_random_valid_scenarios_are_driven_to_their_end(content: Content, lti: Bundle) -> None:
    check_drive(content, lti)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(content=spoilt_contents())
def test_a_spoilt_scenario_is_refused_with_the_names_of_its_fields(content: Content) -> None:
    check_refusal(content)


@pytest.mark.nightly
@settings(max_examples=1500, deadline=None)
@given(content=spoilt_contents())
def test_thousands_of_spoilt_scenarios_are_refused_with_names(content: Content) -> None:
    check_refusal(content)
