"""Tyre property files (`.tir`) of the Magic Formula 5.2 and 6.x: reading and checking.

A file has sections in brackets with lines `KEY = value`, comments from `$` or `!` on, and its units
in the section [UNITS]. The coefficients themselves have no units, except that angles are radians.
"""

from collections.abc import Iterable, Iterator
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.contract.settings_errors import explain
from sim_bridge.plant.tyre_coefficients import (
    LEAST_PLAUSIBLE,
    MOST_PLAUSIBLE,
    TyreFileParameters,
    tyre_quantities,
)

_SCHEMA = TypeAdapter(TyreFileParameters)

_TO_M = {"meter": 1.0, "m": 1.0, "mm": 1e-3, "millimeter": 1e-3, "cm": 1e-2, "inch": 0.0254}
_TO_N = {"newton": 1.0, "n": 1.0, "kilonewton": 1e3, "kn": 1e3, "pound_force": 4.4482216152605}
_TO_RAD = {"radians": 1.0, "radian": 1.0, "rad": 1.0}
_OTHER_SECTIONS = ("UNITS", "MDI_HEADER", "SHAPE")
_SIDES = ("left", "right", "symmetric")
"""values of TYRESIDE; symmetric counts as left"""
_VERSIONS = (5, 6, 52, 60, 61, 62)
"""values of FITTYP: 5 and 52 are version 5.2; 6 and 60 to 62 are 6.x"""
_QUANTITY_NOTES = (
    ("PDX1, LMUX", "peak friction"),
    ("PDY1, LMUY", "peak friction of either sign"),
    ("PKX1, LKX", "slip stiffness over load"),
    ("PKY1, PKY2, PKY4, LKY", "cornering stiffness over load"),
)


class TyreFile(NamedTuple):
    """What was read from a `.tir` file."""

    parameters: TyreFileParameters
    ignored: tuple[str, ...]
    """keys that have no influence on the simulated tyre, as SECTION.KEY"""


def read_tyre_file(path: str | Path) -> TyreFile:
    """The coefficients of a `.tir` file.

    Raises:
        ConfigError: the file cannot be read; keys are missing, occur twice or are no numbers; units
            or version are unknown or missing; or radius, friction or stiffness are none of a tyre.
            The message names all such keys.
    """
    try:
        text = read_text(Path(path), errors="replace")
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a tyre file (.tir) that can be read, found an error: {error}."
        ) from error
    return parse_tyre_file(text, str(path))


def parse_tyre_file(text: str, where: str) -> TyreFile:
    """As `read_tyre_file`, from the text of a file; `where` names it in messages."""
    problems: list[str] = []
    parameters = None
    entries = _entries(text.splitlines(), problems)
    units = {key: value for (section, key), value in entries.items() if section == "UNITS"}
    scales = _scales(units, problems)
    values: dict[str, float] = {}
    ignored = []
    for (section, key), value in entries.items():
        name = key.lower()
        if section in _OTHER_SECTIONS or name == "fittyp":
            continue
        if name == "tyreside":
            if value.lower() not in _SIDES:
                problems.append(
                    f"{section}.TYRESIDE: expected one of {', '.join(_SIDES)}, found {value!r}."
                )
            values["is_right"] = float(value.lower() == "right")
        elif name in TyreFileParameters._fields and name != "is_right":
            values[name] = _number(section, key, value, problems) * scales.get(name, 1.0)
        else:
            ignored.append(f"{section}.{key}")
    _check_version(entries, problems)
    try:
        parameters = _SCHEMA.validate_python(values)
    except ValidationError as error:
        problems += explain(error, lambda place: str(place[0]).upper()).splitlines()
    if parameters is not None and not problems:
        problems += _implausible(parameters)
    if parameters is None or problems:
        raise ConfigError("\n  ".join((f"{where}:", *problems)))
    return TyreFile(parameters, tuple(ignored))


def _entries(lines: Iterable[str], problems: list[str]) -> dict[tuple[str, str], str]:
    """Values by section and key; tables of the section [SHAPE] are left out."""
    found: dict[tuple[str, str], str] = {}
    section = ""
    for number, raw in enumerate(lines, 1):
        line = raw.split("$")[0].split("!")[0].strip()
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1].strip().upper()
        elif "=" in line and not line.startswith("{"):
            key, _, value = line.partition("=")
            place = (section, key.strip().upper())
            if place in found:
                problems.append(f"line {number}, {place[1]}: expected one value, found a second.")
            found[place] = value.strip().strip("'\"").strip()
        elif line and section not in _OTHER_SECTIONS and not line.startswith("{"):
            problems.append(f"line {number}: expected KEY = value, found {line!r}.")
    return found


def _scales(units: dict[str, str], problems: list[str]) -> dict[str, float]:
    """Factors to SI units of the few values that have units."""
    for key, known in (("LENGTH", _TO_M), ("FORCE", _TO_N), ("ANGLE", _TO_RAD)):
        unit = units.get(key)
        if unit is None or unit.lower() not in known:
            found = "none" if unit is None else repr(unit)
            problems.append(f"UNITS.{key}: expected one of {', '.join(known)}, found {found}.")
    return {
        "unloaded_radius": _TO_M.get(units.get("LENGTH", "").lower(), 1.0),
        "fnomin": _TO_N.get(units.get("FORCE", "").lower(), 1.0),
    }


def _implausible(t: TyreFileParameters) -> Iterator[str]:
    """A message for each quantity of the tyre that no tyre of a car has: a wrong unit or digit."""
    for (keys, quantity), found, least, most in zip(
        _QUANTITY_NOTES,
        tyre_quantities(t),
        LEAST_PLAUSIBLE,
        MOST_PLAUSIBLE,
        strict=True,
    ):
        if not least <= found <= most:
            yield f"{keys}: expected a {quantity} of {least:g} to {most:g}, found {found:.4g}."


def _number(section: str, key: str, value: str, problems: list[str]) -> float:
    try:
        number = float(value.lower().replace("d", "e"))
    except ValueError:
        number = nan
    if not isfinite(number):
        problems.append(f"{section}.{key}: expected a number, found {value!r}.")
        return 1.0
    return number


def _check_version(entries: dict[tuple[str, str], str], problems: list[str]) -> None:
    for (section, key), value in entries.items():
        if key == "FITTYP" and not (value.isdigit() and int(value) in _VERSIONS):
            problems.append(
                f"{section}.FITTYP: expected one of {', '.join(map(str, _VERSIONS))} (Magic "
                f"Formula 5.2 or 6.x), found {value}."
            )
