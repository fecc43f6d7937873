"""Scenario files: reading and checking; all errors of a step at once, each with its field.

The steps are the single values, the values of a table together, the whole drive.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.names import split_roads
from rt_controller.contract.settings_errors import LISTED_ERRORS, dotted, explain_field, unlisted
from sim_bridge.faults.fault import FaultFile, late_faults
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.map_drive import scenario_of_map
from sim_bridge.scenario.nominal_drive import fix_path
from sim_bridge.scenario.scenario import Scenario, ScenarioFile
from sim_bridge.toml_file import FileTable, read_shipped_or_own, shipped_names

SCENARIOS_FOLDER = "scenarios"
_FIELD_FIRST = re.compile(r"[a-z_0-9]+(\[\d+\]\.[a-z_]+)?: expected")


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
        return _checked(name_or_path, {}, lambda: scenario_of_map(Path(path), roads))
    where = f"scenario {name_or_path}"
    raw = _toml(where, read_shipped_or_own(name_or_path, SCENARIOS_FOLDER, "scenario"))
    return parse_scenario(raw, where, Path(name_or_path).parent)


def parse_scenario(raw: Mapping[str, Any], where: str, folder: Path = Path()) -> Scenario:
    """The scenario of a parsed file.

    Args:
        raw: the content of the file.
        where: what messages begin with.
        folder: that the files it names are relative to.

    Raises:
        ConfigError: see `load_scenario`.
    """
    return _checked(where, raw, lambda: ScenarioFile.model_validate(raw, context=folder).scenario())


def add_faults(scenario: Scenario, path: Path) -> Scenario:
    """The scenario with the `[[faults]]` of a TOML file that has nothing else.

    Raises:
        ConfigError: the file cannot be read, or fields are refused; the message names them.
    """
    where = f"faults {path}"
    try:
        raw = _toml(where, read_text(path))
        faults = FaultFile.model_validate(raw).faults
    except ValidationError as error:
        raise ConfigError(_listed(where, list(_lines(error, raw)))) from error
    except OSError as error:
        raise ConfigError(
            f"{where}: expected a TOML file, found {error.strerror}. Correct the path."
        ) from error
    except ValueError as error:
        raise ConfigError(
            f"{where}: expected a TOML file in UTF-8, found an error: {error}. Correct the file."
        ) from error
    found = list(late_faults(faults, scenario.duration_s))
    if found:
        raise ConfigError(_listed(where, found))
    return replace(scenario, faults=(*scenario.faults, *faults))


def _toml(where: str, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # no TOML, or a number without end
        raise ConfigError(
            f"{where}: expected a TOML file, found an error: {error}. Correct the file."
        ) from error


def _checked(where: str, raw: Mapping[str, Any], read: Callable[[], Scenario]) -> Scenario:
    """The scenario that `read` returns, if it can be driven."""
    try:
        scenario = read()
        found = problems(scenario)
    except ValidationError as error:
        told = " Write format = 2; the end of docs/scenarios.md says what changed since format 1."
        lines = [f"{x}{told * x.startswith('format:')}" for x in _lines(error, raw)]
        raise ConfigError(_listed(where, lines)) from error
    except ValueError as error:
        raise ConfigError(_listed(where, [str(error)])) from error
    if found:
        raise ConfigError(_listed(where, found))
    return fix_path(scenario)


def _listed(where: str, lines: list[str]) -> str:
    return f"{where}: {lines[0]}" if len(lines) == 1 else "\n  ".join([f"{where}:", *lines])


def _lines(refused: ValidationError, raw: Mapping[str, Any]) -> Iterator[str]:
    errors = [each for each in refused.errors() if each["type"] != "default_factory_not_called"]
    for error in errors[:LISTED_ERRORS]:
        parts = tuple(part for part in error["loc"] if not str(part).startswith("("))
        place = dotted(parts).removesuffix(".[key]")
        if error["type"] != "value_error":
            is_unknown = error["type"] == "extra_forbidden"
            yield explain_field([error], place, _known_beside(raw, parts) if is_unknown else [])
            continue
        # A check of a whole table begins each line with the field.
        is_table = isinstance(error["input"], Mapping)
        for line in str(error["ctx"]["error"]).splitlines():
            separator = "." if is_table and _FIELD_FIRST.match(line) else ": "
            yield f"{place}{separator}{line.rstrip('.')}."
    yield from unlisted(len(errors))


def _known_beside(raw: Any, parts: tuple[str | int, ...]) -> list[str]:
    """The fields of the table that has the most of the names beside a misspelt one."""
    for part in parts[:-1]:
        raw = raw[part]
    names = max(field_names(), key=lambda known: (len(known & set(raw)), -len(known)))
    if not names & set(raw):  # nothing says which table it is
        return sorted(set[str]().union(*field_names()))
    return sorted(names - {str(parts[-1])})


def field_names(table: type[FileTable] = FileTable) -> list[set[str]]:
    """Names of the fields of each table of a scenario file."""
    inner = [names for each in table.__subclasses__() for names in field_names(each)]
    is_own = table.__module__.startswith(("sim_bridge.scenario", "sim_bridge.faults.fault"))
    own = {field.alias or name for name, field in table.model_fields.items()}
    return [own, *inner] if is_own else inner
