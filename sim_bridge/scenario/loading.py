"""Scenario files: reading and checking; all errors of a step at once, each with its field.

The steps are the single values, the values of a table together, the whole drive.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.names import hint
from rt_controller.contract.settings_errors import LISTED_ERRORS, dotted, explain_field, unlisted
from sim_bridge.faults.fault import FaultFile, late_faults
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.file import ScenarioFile
from sim_bridge.scenario.maps.map_drive import scenario_of_map
from sim_bridge.scenario.nominal_drive import fix_path
from sim_bridge.scenario.scenario import Scenario
from sim_bridge.scenario.values import Form, is_tag
from sim_bridge.toml_file import read_shipped_or_own, shipped_names

SCENARIOS_FOLDER = "scenarios"
OPENDRIVE_SUFFIX = ".xodr"
_FORMAT_1 = (
    "Files of format 1 are no longer read. In format 2, speed_kmh is in [reference], moves are "
    '[reference.ey_m] with kind = "moves", and [road] has curvature_per_m and, for '
    "road_friction, friction."
)
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
    path, _, roads = name_or_path.partition("#")
    if path.endswith(OPENDRIVE_SUFFIX):
        return _checked(name_or_path, lambda: scenario_of_map(Path(path), roads))
    shipped = shipped_scenarios()
    if name_or_path not in shipped and not name_or_path.endswith(".toml"):
        raise ConfigError(
            f"scenario {name_or_path!r}: expected one of {', '.join(shipped)} or the path of a "
            f".toml or .xodr file{hint(name_or_path, shipped)}."
        )
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
    version = raw.get("format")
    if version != 2 or isinstance(version, bool):
        found = "none" if version is None else repr(version)
        is_first = version == 1 or (version is None and "reference" not in raw)
        remedy = f" {_FORMAT_1}" if is_first else ""
        raise ConfigError(f"{where}: format: expected 2, found {found}.{remedy}")
    return _checked(where, lambda: ScenarioFile.model_validate(raw, context=folder).scenario())


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
        raise ConfigError(_listed(where, list(_lines(error, ScenarioFile)))) from error
    except (OSError, ValueError) as error:
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


def _checked(where: str, read: Callable[[], Scenario]) -> Scenario:
    """The scenario that `read` returns, if it can be driven."""
    try:
        scenario = read()
        found = problems(scenario)
    except ValidationError as error:
        raise ConfigError(_listed(where, list(_lines(error, ScenarioFile)))) from error
    except ValueError as error:
        raise ConfigError(_listed(where, [str(error)])) from error
    if found:
        raise ConfigError(_listed(where, found))
    return fix_path(scenario)


def _listed(where: str, lines: list[str]) -> str:
    return f"{where}: {lines[0]}" if len(lines) == 1 else "\n  ".join([f"{where}:", *lines])


def _lines(refused: ValidationError, table: type[BaseModel]) -> Iterator[str]:
    errors = [each for each in refused.errors() if each["type"] != "default_factory_not_called"]
    for error in errors[:LISTED_ERRORS]:
        place = dotted(tuple(part for part in error["loc"] if not is_tag(part)))
        place = place.removesuffix(".[key]")
        if error["type"] != "value_error":
            yield explain_field([error], place, sorted(_known_beside(table, error["loc"])))
            continue
        # A check of a whole table begins each line with the field.
        is_table = isinstance(error["input"], Mapping)
        for line in str(error["ctx"]["error"]).splitlines():
            separator = "." if is_table and _FIELD_FIRST.match(line) else ": "
            yield f"{place}{separator}{line.rstrip('.')}."
    yield from unlisted(len(errors))


def _known_beside(table: type[BaseModel], place: tuple[str | int, ...]) -> set[str]:
    """Names of the fields that may stand at a place in a file, in any form of a value there."""
    *before, last = (part for part in place if isinstance(part, str) and not is_tag(part))
    tables = [table]
    for part in before:
        tables = [inner for each in tables for inner in fields_of(each).get(part, ())]
    return {name for each in tables for name in fields_of(each)} - {last}


def fields_of(table: type[BaseModel]) -> dict[str, list[type[BaseModel]]]:
    """Names of the fields of a table, as in a file, and the tables that each may contain."""
    return {
        field.alias or name: [
            inner for part in (field.annotation, *field.metadata) for inner in _tables_in(part)
        ]
        for name, field in table.model_fields.items()
    }


def _tables_in(part: Any) -> Iterator[type[BaseModel]]:
    """The tables that a value of this type, or of this form, may be or contain."""
    if isinstance(part, Form):
        yield from (*part.axes, *part.kinds)
    elif isinstance(part, type) and issubclass(part, BaseModel):
        yield part
    for inner in get_args(part):
        yield from _tables_in(inner)
