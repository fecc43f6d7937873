"""The files of each drive: one log, or a file for each signal as many data sets have them.

A file for each signal is named in the mapping relative to the folder of the drive
("CAN/speed.csv"), with * and ? for parts that vary, or relative to the folder of all drives with
{drive} for the name of the drive ("{drive}_speed.csv", "speed/{drive}.csv").
"""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from rt_controller.contract.errors import DatasetError

DRIVE = "{drive}"
_WILDCARDS = {re.escape("*"): "[^/]*", re.escape("?"): "[^/]"}


class DriveFiles(NamedTuple):
    """Where one drive is recorded."""

    name: str
    """by which the split and the messages call it"""
    path: Path
    """the log, or the folder that the names of its files are relative to"""
    parts: Mapping[str, Path] = MappingProxyType({})
    """by `file` of the mapping; empty if the drive is one log"""

    def label(self, path: Path) -> str:
        """Name of one of its files that tells it from those of other drives."""
        return f"{self.name}/{path.relative_to(self.path).as_posix()}" if self.parts else path.name


def find_drives(place: Path, patterns: Sequence[str]) -> list[DriveFiles]:
    """The drives in a folder and the folders in it, sorted by name.

    Raises:
        DatasetError: there is none, or one lacks a file or has several for one pattern.
    """
    paths = sorted(path for path in place.rglob("*") if path.is_file())
    found: dict[str, dict[str, list[Path]]] = defaultdict(lambda: defaultdict(list))
    for pattern in patterns:
        expression = _expression(pattern)
        for path in paths:
            match = expression.fullmatch(path.relative_to(place).as_posix())
            if match:
                found[match["drive"] or ""][pattern].append(path)
    if not found:
        raise DatasetError(
            f"{place}: expected drives with the files {', '.join(patterns)}, found none in this "
            f"folder and the folders in it. Name the folder that has the drives, or correct "
            f"`file` in the mapping."
        )
    return [_drive(place, name, parts, patterns) for name, parts in sorted(found.items())]


def _drive(
    place: Path, name: str, found: Mapping[str, Sequence[Path]], patterns: Sequence[str]
) -> DriveFiles:
    folder = place if any(DRIVE in pattern for pattern in patterns) else place / name
    for pattern in patterns:
        count = len(found.get(pattern, ()))
        if count != 1:
            listed = ", ".join(path.name for path in found.get(pattern, ()))
            raise DatasetError(
                f"{folder}, drive {name or place.resolve().name}: expected one file {pattern}, "
                f"found {f'{count} ({listed})' if count else 'none'}. Leave the drive out, or "
                f"correct `file` in the mapping."
            )
    parts = {pattern: found[pattern][0] for pattern in patterns}
    return DriveFiles(name or place.resolve().name, folder, parts)


def _expression(pattern: str) -> re.Pattern[str]:
    """Paths relative to the place that fit, with the group `drive`."""
    text = re.escape(pattern)
    for wildcard, expression in _WILDCARDS.items():
        text = text.replace(wildcard, expression)
    if DRIVE not in pattern:
        return re.compile(f"(?:(?P<drive>.+)/)?{text}")
    first, *rest = text.split(re.escape(DRIVE))
    return re.compile(f"{first}(?P<drive>.+?){'(?P=drive)'.join(rest)}")
