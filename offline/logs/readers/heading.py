"""Names of columns: which column of a file a mapping means, and the unit in its name.

Many tools write the unit behind the name: "vx(m/s)", "Speed [km/h]", "Yaw rate, deg/s". A name
may also end in a unit, which is part of it then: "v_kmh".
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from offline.logs.readers.log import Names
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.names import columns_of
from rt_controller.mapping.units import find_unit, unit_of_name

_BRACKETED = re.compile(r"(?P<name>.*\S)\s*[(\[{<](?P<unit>[^()\[\]{}<>]*)[)\]}>]")
_AFTER_COMMA = re.compile(r"(?P<name>.*\S),\s+(?P<unit>\S+)")
_CLEAR_ENDINGS = {
    *("kmh", "kph", "mph", "mps", "mps2", "deg", "degps", "dps", "rad", "radps", "radps2"),
    *("rpm", "bar", "ms"),
}
"""of names; single letters are too often something else"""


class Heading(NamedTuple):
    """A wanted column of a file."""

    name: str
    """as the mapping names it"""
    text: str
    """as the file names it"""
    unit: str | None
    """behind the name in the file, or None"""


def find_headings(path: Path, wanted: Sequence[Names], texts: Sequence[str]) -> list[Heading]:
    """The wanted columns among those of a file; their names may have a unit behind them.

    Raises:
        DatasetError: the file has none, or several, of a wanted name.
    """
    known = [split_unit(text) for text in texts]
    return list(dict.fromkeys(_find(path, names, texts, known) for names in wanted))


def split_unit(text: str) -> Heading:
    """The name without the unit behind it; the whole text if that is no unit."""
    for pattern in (_BRACKETED, _AFTER_COMMA):
        found = pattern.fullmatch(text)
        if found and find_unit(found["unit"]):
            return Heading(found["name"], text, found["unit"])
    ending = text.lower().rpartition("_")[2]
    return Heading(text, text, unit_of_name(text.lower()) if ending in _CLEAR_ENDINGS else None)


def _find(path: Path, names: Names, texts: Sequence[str], known: Sequence[Heading]) -> Heading:
    for name in names:
        fits = [each for each in known if name == each.text] or [
            each for each in known if name == each.name
        ]
        if len(fits) == 1:
            return fits[0]._replace(name=name)
        if fits:
            raise DatasetError(
                f"{path}, column {name}: expected one column of that name, found {len(fits)}. "
                f"Rename them in the file."
            )
    others = f" or {' or '.join(map(repr, names[1:]))}" if names[1:] else ""
    raise DatasetError(
        f"{path}: expected a column {names[0]!r}{others}, found none of that name. "
        f"{columns_of('file', names[0], texts)} Name the column in the mapping as the file does."
    )
