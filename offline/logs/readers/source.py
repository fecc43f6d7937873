"""Logs in files and folders: which drives there are, and their files read on one clock.

A drive is one log, or has a file for each signal as many data sets have them. Such a file is named
in the mapping relative to the folder of the drive ("CAN/speed.csv"), with * and ? for parts that
vary, or relative to the folder of all drives with {drive} for the name of the drive
("{drive}_speed.csv", "speed/{drive}.csv").
"""

import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import pandas as pd

from offline.data.manifest import SourceFile
from offline.logs.mapping import LogMapping
from offline.logs.readers.formats import SUFFIXES, read_file
from offline.logs.readers.log import Heading, Log, Request
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.mapping.slots import Slot
from rt_controller.mapping.tables import Clock

DRIVE = "{drive}"
_EVERY_ROW = Clock(period_s=1.0)


class DriveFiles(NamedTuple):
    """Where one drive is recorded: one log, or a folder and its files by `file` of the mapping."""

    name: str
    path: Path
    parts: Mapping[str, Path] = MappingProxyType({})


def find_logs(places: Sequence[Path], mapping: LogMapping) -> list[DriveFiles]:
    """The drives in these files and folders, sorted by name within a folder.

    A reference line in the same folder is not a log, nor is a text file beside other logs.

    Raises:
        ConfigError: a place does not exist, has an unknown ending, or a name occurs twice.
        DatasetError: a folder has no logs, or a drive in several files is not complete.
    """
    found: list[DriveFiles] = []
    for place in places:
        if not place.exists():
            raise ConfigError(f"{place}: expected a log or a folder of logs, found nothing.")
        if not mapping.files:
            found += [DriveFiles(path.name, path) for path in _logs_in(place, mapping)]
        elif place.is_dir():
            found += _drives_in(place, mapping.files)
        else:
            raise ConfigError(
                f"{place}: expected a folder, because `file` in the mapping names a file for each "
                f"signal, found one file. Name the folder of the drive, or of all drives."
            )
    repeated = sorted(name for name, n in Counter(each.name for each in found).items() if n > 1)
    if repeated:
        raise ConfigError(
            f"expected logs with different names, because the split and the messages use the name, "
            f"found twice: {', '.join(repeated)}. Rename or leave out."
        )
    return found


def _drives_in(place: Path, patterns: Sequence[str]) -> Iterator[DriveFiles]:
    """The drives in a folder and the folders in it that have a file for each signal."""
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
    for stem, files in sorted(found.items()):
        name = stem or place.resolve().name
        folder = place if any(DRIVE in pattern for pattern in patterns) else place / stem
        for pattern in patterns:
            if len(fits := files[pattern]) != 1:
                listed = f"{len(fits)} ({', '.join(path.name for path in fits)})"
                raise DatasetError(
                    f"{folder}, drive {name}: expected one file {pattern}, found "
                    f"{listed if fits else 'none'}. Leave the drive out, or correct `file` in the "
                    f"mapping."
                )
        yield DriveFiles(name, folder, {pattern: files[pattern][0] for pattern in patterns})


def _expression(pattern: str) -> re.Pattern[str]:
    """Paths relative to the place that fit, with the group `drive`."""
    text = re.escape(pattern).replace(r"\*", "[^/]*").replace(r"\?", "[^/]")
    if DRIVE not in pattern:
        return re.compile(f"(?:(?P<drive>.+)/)?{text}")
    first, *rest = text.split(re.escape(DRIVE))
    return re.compile(f"{first}(?P<drive>.+?){'(?P=drive)'.join(rest)}")


def _logs_in(place: Path, mapping: LogMapping) -> list[Path]:
    if not place.is_dir():
        if not _is_log(place):
            raise ConfigError(
                f"{place}: expected a log of a known kind ({', '.join(SUFFIXES)}), found another "
                f"ending. Export it to one of these."
            )
        return [place]
    line = mapping.pose and mapping.pose.reference_line
    inside = [path for path in sorted(place.iterdir()) if _is_log(path)]
    if line and line.exists():
        inside = [path for path in inside if not path.samefile(line)]
    if not inside:
        raise DatasetError(
            f"{place}: expected logs ({', '.join(SUFFIXES)}), found a folder without any. "
            f"Name another folder, or the files themselves; for drives with a file for each "
            f"signal, write `file` in the mapping."
        )
    return [path for path in inside if ".txt" not in path.suffixes] or inside


def _is_log(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


def read_log(drive: DriveFiles, mapping: LogMapping) -> Log:
    """The columns of the mapping, read from the files of a drive.

    Raises:
        DatasetError: see `read_file`; or the files of the drive have no time in common.
        MissingExtraError: the package that reads such logs is not installed.
    """
    groups: dict[tuple[str | None, Clock], list[Slot]] = defaultdict(list)
    for slot in mapping.slots:
        groups[slot.column.file, slot.column.time or mapping.time].append(slot)
    parts = []
    for (file, clock), slots in groups.items():
        path, wanted = drive.parts[file] if file else drive.path, [s.column.names for s in slots]
        ask = Request(path, wanted, clock, mapping.csv, mapping.can, slots, mapping.messages)
        log = _read_part(ask)
        parts.append(replace(log, columns=tuple(replace(c, file=file) for c in log.columns)))
    return replace(_on_one_clock(parts), name=drive.name)


def _read_part(ask: Request) -> Log:
    """The wanted columns of one file; their times may be in another one."""
    clock = ask.clock
    if clock.file is None:
        return read_file(ask)
    log = read_file(ask._replace(clock=_EVERY_ROW))
    beside = _file_of_times(ask.path, clock.file)
    of_times = ask._replace(path=beside, wanted=[clock.names or ("1",)], clock=_EVERY_ROW)
    (stamps,) = read_file(of_times).columns
    if len(stamps.values) != log.rows:
        raise DatasetError(
            f"{ask.path}: expected a time for each of its {log.rows} rows, found "
            f"{len(stamps.values)} in {beside}. Export both again, or leave the drive out."
        )
    first = log.columns[0]
    frame = pd.DataFrame({each.name: each.values for each in log.columns}, index=first.row)
    frame[str(beside)] = stamps.values
    time = Heading(f"{stamps.name} of {beside}", str(beside), stamps.unit)
    headings = [Heading(each.name, each.name, each.unit) for each in log.columns]
    return ask.to_log(frame, [time, *headings], word=first.word)


def _file_of_times(path: Path, pattern: str) -> Path:
    return path.parent / pattern.replace("{name}", path.name.partition(".")[0])


def _on_one_clock(parts: Sequence[Log]) -> Log:
    """All parts as one log whose times count from the earliest begin of any."""
    known = [part.begin_s for part in parts if part.begin_s is not None]
    columns = []
    for part in parts:
        ahead_s = 0.0 if part.begin_s is None else part.begin_s - min(known)
        columns += [replace(each, t_s=each.t_s + ahead_s) for each in part.columns]
    late = max(columns, key=lambda each: each.t_s[0])
    early = min(columns, key=lambda each: each.t_s[-1])
    if late.t_s[0] >= early.t_s[-1]:
        raise DatasetError(
            f"{late.place}: expected times in common with {early.place}, found that it begins "
            f"{late.t_s[0] - early.t_s[-1]:.6g} s after the other ends. Write the unit of each "
            f"clock in [time], or in `time` of the signal; if all files began together, write "
            f"starts_at_zero = true."
        )
    return replace(parts[0], columns=tuple(columns), rows=max(part.rows for part in parts))


def source_files(drive: DriveFiles, mapping: LogMapping) -> Iterator[SourceFile]:
    """Name and SHA-256 of every file of a drive; the name tells it from those of other drives."""
    paths = dict.fromkeys(drive.parts.values()) or {drive.path: None}
    for column in mapping.every_column:
        clock = column.time or mapping.time
        if clock.file and column.file:
            paths[_file_of_times(drive.parts[column.file], clock.file)] = None
    for path in paths:
        inside = path.relative_to(drive.path).as_posix()
        yield source_file(path, f"{drive.name}/{inside}" if drive.parts else path.name)


def source_file(path: Path, name: str) -> SourceFile:
    """Name and SHA-256 of a file that the data set was made from."""
    with path.open("rb") as file:
        return SourceFile(name, hashlib.file_digest(file, "sha256").hexdigest())
