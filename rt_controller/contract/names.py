"""Messages for a name that is not known, and the name of a map with roads."""

import re
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from pathlib import Path

from rt_controller.contract.errors import ConfigError

MODEL_FOLDER = "a folder that offline-export wrote"
"""what a model may be that is not a shipped one"""
NEAR = 0.75
"""least share of letters that two names have in common, for one to be a misspelling of the other"""
_ROADS_OF_MAP = re.compile(r"(.*\.xodr)#(?!.*\.(?:toml|xodr)$)([^/\\]*)", re.I | re.S)


def split_roads(name: str) -> tuple[str, str]:
    """The path of a map and the roads behind it (map.xodr#ROAD,ROAD), or the name and "".

    Only behind .xodr a # separates; elsewhere it is a part of the path.
    """
    found = _ROADS_OF_MAP.fullmatch(name)
    return (found[1], found[2]) if found else (name, "")


def label_paths(paths: Sequence[Path], option: str, taken: Collection[str] = ()) -> tuple[str, ...]:
    """A label for each path: its last part, with as many folders before it as make it unique.

    Raises:
        ConfigError: `option` names one of them twice, or `taken` has all labels of one.
    """
    parts = [path.resolve().parts for path in paths]
    for depth in range(1, max(map(len, parts)) + 1):
        labels = ["/".join(each[-depth:]) for each in parts]
        if len({*labels, *taken}) == len(labels) + len(taken):
            return tuple(labels)
    raise ConfigError(
        f"{option}: expected different paths, found one of them twice among "
        f"{', '.join(map(str, paths))}. Name each of them once."
    )


def near_names(found: str, names: Collection[str], most: int = 1) -> list[str]:
    """Those of the names that `found` may be, the nearest first: without its unit, or misspelt."""
    lowered = {name.lower(): name for name in names}
    whole = [name for name in lowered if name.startswith(f"{found.lower()}_")]
    near = [*whole, *get_close_matches(found.lower(), lowered, most, NEAR)]
    return [lowered[name] for name in dict.fromkeys(near)][:most]


def hint(found: str, names: Collection[str]) -> str:
    """ " (did you mean NAME?)" with the name most similar to `found`; empty if none is."""
    near = near_names(found, names)
    return f" (did you mean {near[0]}?)" if near else ""


def columns_of(holder: str, wanted: str, available: Sequence[str]) -> str:
    """What has to follow "found none of that name": similar columns, and those that there are."""
    near = near_names(wanted, available, most=3)
    similar = f"Did you mean {' or '.join(near)}? " if near else ""
    more = ", …" * (len(available) > 40)
    return f"{similar}The {holder} has: {', '.join(available[:40])}{more}."


def name_or(found: str, names: Collection[str], otherwise: str) -> str:
    """What was expected in place of `found`: one of the names, or something else."""
    return f"expected one of {', '.join(names)}{hint(found, names)}, or {otherwise}"
