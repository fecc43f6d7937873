"""Tyre property files (`.tir`) of the Magic Formula 5.2 and 6.x: reading and checking.

A file has sections in brackets with lines `KEY = value`, comments from `$` or `!` on, and its units
in the section [UNITS]. The coefficients themselves have no units, except that angles are radians.
"""

from collections import namedtuple
from collections.abc import Iterable, Iterator
from math import atan, inf, isfinite, nan, sin
from pathlib import Path

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text

TyreFileParameters = namedtuple(
    "TyreFileParameters",
    "fnomin unloaded_radius pcx1 pdx1 pkx1 pcy1 pdy1 pky1 pky2 is_right lfzo lcx lmux lex lkx lhx "
    "lvx lgax lcy lmuy ley lky lhy lvy lgay ltr lres lgaz lxal lyka lvyka ls pdx2 pdx3 pex1 pex2 "
    "pex3 pex4 pkx2 pkx3 phx1 phx2 pvx1 pvx2 rbx1 rbx2 rbx3 rcx1 rex1 rex2 rhx1 pdy2 pdy3 pey1 "
    "pey2 pey3 pey4 pey5 pky3 pky4 pky5 pky6 pky7 phy1 phy2 phy3 pvy1 pvy2 pvy3 pvy4 rby1 rby2 "
    "rby3 rby4 rcy1 rey1 rey2 rhy1 rhy2 rvy1 rvy2 rvy3 rvy4 rvy5 rvy6 qbz1 qbz2 qbz3 qbz4 qbz5 "
    "qbz9 qbz10 qcz1 qdz1 qdz2 qdz3 qdz4 qdz6 qdz7 qdz8 qdz9 qdz10 qdz11 qez1 qez2 qez3 qez4 qez5 "
    "qhz1 qhz2 qhz3 qhz4 ssz1 ssz2 ssz3 ssz4",
)
TyreFileParameters.__doc__ = """Coefficients of a `.tir` file, with its names in lower case.

`fnomin` is the nominal load in N, 0 if there is no such file; `unloaded_radius` is in m; `is_right`
is 1 for a tyre that was measured on the right side of a car (TYRESIDE), else 0.
"""
_REQUIRED = TyreFileParameters._fields[:9]
# Factors of scale are 1; PKY4 is 2 in version 5.2, which has no such coefficient.
_DEFAULTS = {
    name: 1.0 if name.startswith("l") else 2.0 if name == "pky4" else 0.0
    for name in TyreFileParameters._fields[9:]
}
NO_TYRE_FILE = TyreFileParameters(0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0, **_DEFAULTS)

_POSITIVE = (
    *("fnomin", "pcx1", "pdx1", "pkx1", "pcy1", "pky2", "pky4"),
    *("lfzo", "lcx", "lmux", "lkx", "lcy", "lmuy", "lky"),
)
_TO_M = {"meter": 1.0, "m": 1.0, "mm": 1e-3, "millimeter": 1e-3, "cm": 1e-2, "inch": 0.0254}
_TO_N = {"newton": 1.0, "n": 1.0, "kilonewton": 1e3, "kn": 1e3, "pound_force": 4.4482216152605}
_TO_RAD = {"radians": 1.0, "radian": 1.0, "rad": 1.0}
_OTHER_SECTIONS = ("UNITS", "MDI_HEADER", "SHAPE")
_SIDES = ("left", "right", "symmetric")
"""values of TYRESIDE; symmetric counts as left"""
_VERSIONS = ("5", "6", "52", "60", "61", "62")
"""values of FITTYP: 5 and 52 are version 5.2; 6 and 60 to 62 are 6.x"""


def read_tyre_file(path: str | Path) -> TyreFileParameters:
    """The coefficients of a `.tir` file; keys that do not act on the simulated tyre are left out.

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


def parse_tyre_file(text: str, where: str) -> TyreFileParameters:
    """As `read_tyre_file`, from the text of a file; `where` names it in messages."""
    problems: list[str] = []
    entries = _entries(text.splitlines(), problems)
    scales = {
        "unloaded_radius": _scale("LENGTH", _TO_M, entries, problems),
        "fnomin": _scale("FORCE", _TO_N, entries, problems),
    }
    _scale("ANGLE", _TO_RAD, entries, problems)
    values: dict[str, float] = {**_DEFAULTS}
    for (section, key), text_value in entries.items():
        name, place = key.lower(), f"{section}.{key}"
        if section in _OTHER_SECTIONS:
            continue
        if name == "fittyp" and text_value not in _VERSIONS:
            problems.append(
                f"{place}: expected one of {', '.join(_VERSIONS)} (Magic Formula 5.2 or 6.x), "
                f"found {text_value}."
            )
        elif name == "tyreside":
            if text_value.lower() not in _SIDES:
                wanted = f"one of {', '.join(_SIDES)}"
                problems.append(f"{place}: expected {wanted}, found {text_value!r}.")
            values["is_right"] = float(text_value.lower() == "right")
        elif name in TyreFileParameters._fields and name != "is_right":
            value = _number(text_value)
            if not isfinite(value):
                problems.append(f"{place}: expected a number, found {text_value!r}.")
            values[name] = value * scales.get(name, 1.0)
    problems += (
        f"{name.upper()}: expected a value, found none." for name in _REQUIRED if name not in values
    )
    problems = problems or [*_implausible(TyreFileParameters(**values))]
    if problems:
        raise ConfigError("\n  ".join((f"{where}:", *problems)))
    return TyreFileParameters(**values)


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


def _scale(
    key: str, known: dict[str, float], entries: dict[tuple[str, str], str], problems: list[str]
) -> float:
    """Factor from a unit of the section [UNITS] to the SI unit."""
    unit = entries.get(("UNITS", key))
    if unit is None or unit.lower() not in known:
        found = "none" if unit is None else repr(unit)
        problems.append(f"UNITS.{key}: expected one of {', '.join(known)}, found {found}.")
        return 1.0
    return known[unit.lower()]


def _number(text: str) -> float:
    try:
        return float(text.lower().replace("d", "e"))
    except ValueError:
        return nan


def _implausible(t: TyreFileParameters) -> Iterator[str]:
    """A message for each number or quantity that no tyre of a car has: a wrong unit or digit."""
    for name in _POSITIVE:
        if not getattr(t, name) > 0.0:
            yield f"{name.upper()}: expected more than 0.0, found {getattr(t, name)}."
    if not t.pky1 < 0.0:
        wanted = "a negative number, as the ISO axes of these files have it"
        yield f"PKY1: expected {wanted}, found {t.pky1}."
    stiffness = abs(t.pky1) * sin(t.pky4 * atan(1.0 / (t.pky2 or inf))) * t.lky
    # Least friction: wet ice. Tyres of trucks and racing cars have stiffnesses of 5 to 100.
    for keys, quantity, found, least, most in (
        ("UNLOADED_RADIUS", "radius in m", t.unloaded_radius, 0.1, 2.0),
        ("PDX1, LMUX", "peak friction", t.pdx1 * t.lmux, 0.2, 2.5),
        ("PDY1, LMUY", "peak friction of either sign", abs(t.pdy1) * t.lmuy, 0.2, 2.5),
        ("PKX1, LKX", "slip stiffness over load", t.pkx1 * t.lkx, 2.0, 200.0),
        ("PKY1, PKY2, PKY4, LKY", "cornering stiffness over load", stiffness, 2.0, 200.0),
    ):
        if not least <= found <= most:
            yield f"{keys}: expected a {quantity} of {least:g} to {most:g}, found {found:.4g}."
