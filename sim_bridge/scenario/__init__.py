"""Scenarios: roads, wanted speeds and paths, stops, faults and figures, as data.

A scenario file is TOML (`docs/scenarios.md`); the shipped ones are in `sim_bridge/scenarios/`.
"""

from sim_bridge.scenario.loading import load_scenario as load_scenario
from sim_bridge.scenario.loading import parse_scenario as parse_scenario
from sim_bridge.scenario.loading import shipped_scenarios as shipped_scenarios
from sim_bridge.scenario.scenario import Scenario as Scenario
