"""Scenario files: reading and checking; all errors of a step at once, each with its field.

The steps are the single values, the values of a table together, the whole drive.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import split_roads
from rt_controller.mapping.toml_file import checked, listed, parse, read_own
from sim_bridge.faults.fault import FaultFile, late_faults
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.map_drive import content_of_map
from sim_bridge.scenario.nominal_drive import fix_path
from sim_bridge.scenario.scenario import Scenario
from sim_bridge.toml_file import read_shipped_or_own, shipped_names

SCENARIOS_FOLDER = "scenarios"
_SCENARIO, _FAULTS = TypeAdapter(Scenario), TypeAdapter(FaultFile)


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    return shipped_names(SCENARIOS_FOLDER)


def load_scenario(name_or_path: str) -> Scenario:
    """A shipped scenario by name, or one from a file.

    The suffix of a file decides: `.toml` is a scenario file, `.xodr` an OpenDRIVE map
    (`map.xodr#5,-7` names the roads).

    Raises:
        ConfigError: there is no such scenario, or fields are missing, unknown, out of their limits
            or do not fit each other. The message names all such fields that a step of the check
            finds.
    """
    path, roads = split_roads(name_or_path)
    if path.lower().endswith(".xodr"):
        return parse_scenario(content_of_map(Path(path), roads), name_or_path)
    where = f"scenario {name_or_path}"
    text = read_shipped_or_own(name_or_path, SCENARIOS_FOLDER, "scenario")
    return _drivable(parse(text, _SCENARIO, where, Path(name_or_path).parent), where)


def parse_scenario(raw: Mapping[str, Any], where: str, folder: Path = Path()) -> Scenario:
    """The scenario of a parsed file.

    Args:
        raw: the content of the file.
        where: what messages begin with.
        folder: that the files it names are relative to.

    Raises:
        ConfigError: see `load_scenario`.
    """
    return _drivable(checked(raw, _SCENARIO, where, folder), where)


def add_faults(scenario: Scenario, path: Path) -> Scenario:
    """The scenario with the `[[faults]]` of a TOML file that has nothing else.

    Raises:
        ConfigError: the file cannot be read, or fields are refused; the message names them.
    """
    where = f"faults {path}"
    faults = parse(read_own(path, "faults"), _FAULTS, where).faults
    if late := list(late_faults(faults, scenario.duration_s)):
        raise ConfigError(listed(where, late))
    return replace(scenario, faults=(*scenario.faults, *faults))


def _drivable(scenario: Scenario, where: str) -> Scenario:
    if found := problems(scenario):
        raise ConfigError(listed(where, found))
    return fix_path(scenario)
