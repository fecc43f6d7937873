"""Scenario files: reading and checking; all errors of a step at once, each with its field.

The steps are the single values, the values of a table together, road and start, the whole drive.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, Tag, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.settings_errors import LISTED_ERRORS, dotted, explain_field, unlisted
from sim_bridge.faults.fault import FaultFile, late_faults
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.field_names import FORMAT_1, FORMAT_2, MAP, FieldNames
from sim_bridge.scenario.files.fields import is_tag
from sim_bridge.scenario.files.format1 import Format1
from sim_bridge.scenario.files.format2 import Format2
from sim_bridge.scenario.nominal_drive import fix_path
from sim_bridge.scenario.scenario import Scenario
from sim_bridge.toml_file import read_shipped_or_own, shipped_names

SCENARIOS_FOLDER = "scenarios"
FORMATS = (1, 2)
OPENDRIVE_SUFFIX = ".xodr"
_FIELD_FIRST = re.compile(r"[a-z_0-9]+(\[\d+\]\.[a-z_]+)?: expected")


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    return shipped_names(SCENARIOS_FOLDER)


def load_scenario(name_or_path: str) -> Scenario:
    """A shipped scenario by name, or one from a file.

    The suffix of a file decides: `.toml` is this project's format 1 or 2, `.xodr` an OpenDRIVE
    map (`map.xodr#5,-7` names the roads).

    Raises:
        ConfigError: there is no such scenario, or fields are missing, unknown, out of their limits
            or do not fit each other. The message names all such fields that a step of the check
            finds.
    """
    path, _, roads = name_or_path.partition("#")
    if path.endswith(OPENDRIVE_SUFFIX):
        from sim_bridge.scenario.maps.map_drive import scenario_of_map

        return _checked(scenario_of_map(Path(path), roads), name_or_path, MAP)
    shipped = shipped_scenarios()
    if name_or_path not in shipped and not name_or_path.endswith(".toml"):
        near = get_close_matches(name_or_path, shipped, n=1)
        raise ConfigError(
            f"scenario {name_or_path!r}: expected one of {', '.join(shipped)} or the path of a "
            f".toml or .xodr file.{f' Did you mean {near[0]}?' if near else ''}"
        )
    text = read_shipped_or_own(name_or_path, SCENARIOS_FOLDER, "scenario")
    try:
        raw: dict[str, Any] = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # no TOML, or a number without end
        raise ConfigError(
            f"scenario {name_or_path}: expected a TOML file, found an error: {error}. Correct the "
            f"file."
        ) from error
    return parse_scenario(raw, f"scenario {name_or_path}", Path(name_or_path).parent)


def parse_scenario(raw: Mapping[str, Any], where: str, folder: Path = Path()) -> Scenario:
    """The scenario of a parsed file.

    Args:
        raw: the content of the file.
        where: what messages begin with.
        folder: that the files it names are relative to.

    Raises:
        ConfigError: see `load_scenario`.
    """
    version = raw.get("format", 1)
    if "format" not in raw and "reference" in raw:
        raise ConfigError(f"{where}: format: expected 2 in a file with [reference], found none.")
    if version not in FORMATS or isinstance(version, bool):
        raise ConfigError(f"{where}: format: expected 1 or 2, found {version!r}.")
    table: type[Format1] | type[Format2] = Format1 if version == 1 else Format2
    try:
        scenario = table.model_validate(raw).scenario(folder)
    except ValidationError as error:
        raise ConfigError(_listed(where, list(_lines(error, table)))) from error
    except ValueError as error:
        raise ConfigError(_listed(where, [str(error)])) from error
    return _checked(scenario, where, FORMAT_1 if version == 1 else FORMAT_2)


def add_faults(scenario: Scenario, path: Path) -> Scenario:
    """The scenario with the `[[faults]]` of a TOML file that has nothing else.

    Raises:
        ConfigError: the file cannot be read, or fields are refused; the message names them.
    """
    where = f"faults {path}"
    try:
        raw = tomllib.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(
            f"{where}: expected a TOML file in UTF-8, found an error: {error}. Correct the file."
        ) from error
    try:
        faults = FaultFile.model_validate(raw).faults
    except ValidationError as error:
        raise ConfigError(_listed(where, list(_lines(error, FaultFile)))) from error
    found = list(late_faults(faults, scenario.duration_s))
    if found:
        raise ConfigError(_listed(where, found))
    return replace(scenario, faults=(*scenario.faults, *faults))


def _checked(scenario: Scenario, where: str, names: FieldNames) -> Scenario:
    found = problems(scenario, names)
    if found:
        raise ConfigError(_listed(where, found))
    return fix_path(scenario)


def _listed(where: str, lines: list[str]) -> str:
    return f"{where}: {lines[0]}" if len(lines) == 1 else "\n  ".join([f"{where}:", *lines])


def _lines(refused: ValidationError, table: type[BaseModel]) -> Iterator[str]:
    errors = refused.errors()
    for error in errors[:LISTED_ERRORS]:
        place = dotted(tuple(part for part in error["loc"] if not is_tag(part)))
        place = place.removesuffix(".[key]")
        if error["type"] != "value_error":
            yield explain_field([error], place, sorted(known_fields(table, error["loc"])))
            continue
        # A check of a whole table begins each line with the field.
        is_table = isinstance(error["input"], Mapping)
        for line in str(error["ctx"]["error"]).splitlines():
            separator = "." if is_table and _FIELD_FIRST.match(line) else ": "
            yield f"{place}{separator}{line.rstrip('.')}."
    yield from unlisted(len(errors))


def known_fields(table: type[BaseModel], place: tuple[str | int, ...]) -> set[str]:
    """Names of the fields that may stand at a place inside a table."""
    annotations: list[Any] = [table]
    for part in place[:-1]:
        if is_tag(part):
            annotations = [one for kind in annotations for one in _with_tag(kind, str(part))]
        elif isinstance(part, str):
            tables = [one for kind in annotations for one in tables_in(kind)]
            fields = [one.model_fields[part] for one in tables if part in one.model_fields]
            annotations = [field.annotation for field in fields]
    return {name for kind in annotations for one in tables_in(kind) for name in one.model_fields}


def _with_tag(annotation: Any, tag: str) -> Iterator[Any]:
    """The forms of a value that have this tag."""
    parts = get_args(annotation)
    if any(isinstance(part, Tag) and part.tag == tag for part in parts):
        yield parts[0]
    for part in parts:
        yield from _with_tag(part, tag)


def tables_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables that a value of this type may be or contain."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from tables_in(part)
