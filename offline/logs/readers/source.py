"""Logs in files and folders: which drives there are, and which reader reads each file.

A drive is one log, or has a file for each signal as many data sets have them. Such a file is named
in the mapping relative to the folder of the drive ("CAN/speed.csv"), with * and ? for parts that
vary, or relative to the folder of all drives with {drive} for the name of the drive
("{drive}_speed.csv", "speed/{drive}.csv").
"""

import hashlib
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import pandas as pd

from offline.data.manifest import SourceFile
from offline.logs.mapping import CsvSettings, LogMapping
from offline.logs.readers.array_log import read_mat, read_npy, read_npz, read_parquet
from offline.logs.readers.csv_log import CSV_SUFFIXES, read_csv
from offline.logs.readers.log import Columns, Heading, Log, Names, readable, to_log
from offline.logs.readers.mf4_log import read_mf4
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.mapping.tables import Clock

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
    drives = []
    for stem, files in sorted(found.items()):
        name = stem or place.resolve().name
        folder = place if any(DRIVE in pattern for pattern in patterns) else place / stem
        for pattern in patterns:
            if len(paths := files[pattern]) != 1:
                listed = f"{len(paths)} ({', '.join(path.name for path in paths)})"
                raise DatasetError(
                    f"{folder}, drive {name}: expected one file {pattern}, found "
                    f"{listed if paths else 'none'}. Leave the drive out, or correct `file` in the "
                    f"mapping."
                )
        parts = {pattern: files[pattern][0] for pattern in patterns}
        drives.append(DriveFiles(name, folder, parts))
    return drives


def _expression(pattern: str) -> re.Pattern[str]:
    """Paths relative to the place that fit, with the group `drive`."""
    text = re.escape(pattern)
    for wildcard, expression in _WILDCARDS.items():
        text = text.replace(wildcard, expression)
    if DRIVE not in pattern:
        return re.compile(f"(?:(?P<drive>.+)/)?{text}")
    first, *rest = text.split(re.escape(DRIVE))
    return re.compile(f"{first}(?P<drive>.+?){'(?P=drive)'.join(rest)}")


_TABLE_READERS = {
    ".npz": read_npz,
    ".npy": read_npy,
    ".mat": read_mat,
    ".parquet": read_parquet,
    ".pq": read_parquet,
}
_MF4_SUFFIXES = (".mf4", ".mdf", ".dat")
_CAN_SUFFIXES = (".blf", ".asc", ".log", ".trc")
SUFFIXES = (*CSV_SUFFIXES, *_TABLE_READERS, *_MF4_SUFFIXES, *_CAN_SUFFIXES)
_MAGIC_OF_NPY, _MAGIC_OF_MDF = b"\x93NUMPY", (b"MDF", b"UnFinMF")
_EVERY_ROW = Clock(period_s=1.0)
_PLAIN_CSV = CsvSettings()


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
        if mapping.files:
            if not place.is_dir():
                raise ConfigError(
                    f"{place}: expected a folder, because `file` in the mapping names a file for "
                    f"each signal, found one file. Name the folder of the drive, or of all drives."
                )
            found += find_drives(place, mapping.files)
        else:
            found += [DriveFiles(path.name, path) for path in _logs_in(place, mapping)]
    names = [drive.name for drive in found]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigError(
            f"expected logs with different names, because the split and the messages use the name, "
            f"found twice: {', '.join(repeated)}. Rename or leave out."
        )
    return found


def read_log(drive: DriveFiles, mapping: LogMapping) -> Log:
    """The columns of the mapping, read from the files of a drive.

    Raises:
        DatasetError: a file or its DBC is missing, damaged, truncated or of a version that cannot
            be read; a column is missing, ambiguous or has no numbers; time is missing, runs
            backwards or has another period than the mapping; a frame is shorter than its message;
            the files of the drive have no time in common.
        MissingExtraError: the package that reads such logs is not installed.
    """
    groups: dict[tuple[str | None, Clock], list[Names]] = defaultdict(list)
    for column in mapping.every_column:
        groups[column.file, column.time or mapping.time].append(column.names)
    parts = []
    for (file, clock), wanted in groups.items():
        log = _read_part(drive.parts[file] if file else drive.path, wanted, clock, mapping)
        parts.append(replace(log, channels=tuple(replace(c, file=file) for c in log.channels)))
    return replace(_on_one_clock(parts), name=drive.name, path=drive.path)


def source_files(drive: DriveFiles, mapping: LogMapping) -> Iterator[SourceFile]:
    """Name and SHA-256 of every file of a drive."""
    paths = dict.fromkeys(drive.parts.values()) or {drive.path: None}
    for column in mapping.every_column:
        clock = column.time or mapping.time
        if clock.file and column.file:
            paths[_file_of_times(drive.parts[column.file], clock.file)] = None
    for path in paths:
        yield source_file(path, drive.label(path))


def source_file(path: Path, name: str) -> SourceFile:
    """Name and SHA-256 of a file that the data set was made from."""
    with path.open("rb") as file:
        return SourceFile(name, hashlib.file_digest(file, "sha256").hexdigest())


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


def _read_part(path: Path, wanted: Sequence[Names], clock: Clock, mapping: LogMapping) -> Log:
    """The wanted columns of one file; their times may be in another one."""
    if clock.file is None:
        return _read_file(path, wanted, clock, mapping)
    log = _read_file(path, wanted, _EVERY_ROW, mapping)
    beside = _file_of_times(path, clock.file)
    (stamps,) = _read_file(beside, [clock.names or ("1",)], _EVERY_ROW, mapping).channels
    if len(stamps.values) != log.rows:
        raise DatasetError(
            f"{path}: expected a time for each of its {log.rows} rows, found {len(stamps.values)} "
            f"in {beside}. Export both again, or leave the drive out."
        )
    of, columns = log.channels[0].of, {each.column: each for each in log.channels}
    frame = pd.DataFrame({name: each.values for name, each in columns.items()})
    frame.index = pd.Index(log.channels[0].row)
    time = Heading(f"{stamps.column} of {beside}", str(beside), stamps.unit)
    frame[time.text] = stamps.values
    headings = [Heading(name, name, each.unit) for name, each in columns.items()]
    return to_log(of, frame, Columns(time, headings), clock)


def _file_of_times(path: Path, pattern: str) -> Path:
    return path.parent / pattern.replace("{name}", path.name.partition(".")[0])


def _read_file(path: Path, wanted: Sequence[Names], clock: Clock, mapping: LogMapping) -> Log:
    """The wanted columns of one file, by its ending, or by its first bytes."""
    name, suffix = path.name.lower(), path.suffix.lower()
    head = _head(path)
    if name.endswith(_MF4_SUFFIXES) and (suffix != ".dat" or head.startswith(_MAGIC_OF_MDF)):
        return read_mf4(path, wanted)
    if name.endswith(_CAN_SUFFIXES) and not head.startswith(_MAGIC_OF_NPY):
        # python-can and cantools are imported for such logs only.
        from offline.logs.readers.can_log import read_can

        return read_can(path, wanted, mapping.can)
    return read_table(path, wanted, clock, mapping.csv)


def read_table(
    path: Path, wanted: Sequence[Names], clock: Clock, style: CsvSettings = _PLAIN_CSV
) -> Log:
    """The wanted columns of a CSV, npz, npy, MATLAB or Parquet file.

    Raises:
        DatasetError: see `read_log`.
        MissingExtraError: the package that reads such logs is not installed.
    """
    is_npy = _head(path).startswith(_MAGIC_OF_NPY)
    reader = read_npy if is_npy else _TABLE_READERS.get(path.suffix.lower())
    return reader(path, wanted, clock) if reader else read_csv(path, wanted, clock, style)


def _head(path: Path) -> bytes:
    with readable(path, "a log", (OSError,)), path.open("rb") as file:
        return file.read(8)


def _on_one_clock(parts: Sequence[Log]) -> Log:
    """All parts as one log whose times count from the earliest begin of any."""
    known = [part.begin_s for part in parts if part.begin_s is not None]
    channels = []
    for part in parts:
        ahead_s = 0.0 if part.begin_s is None else part.begin_s - min(known)
        channels += [replace(each, t_s=each.t_s + ahead_s) for each in part.channels]
    late = max(channels, key=lambda each: each.t_s[0])
    early = min(channels, key=lambda each: each.t_s[-1])
    if late.t_s[0] >= early.t_s[-1]:
        raise DatasetError(
            f"{late.place}: expected times in common with {early.place}, found that it begins "
            f"{late.t_s[0] - early.t_s[-1]:.6g} s after the other ends. Write the unit of each "
            f"clock in [time], or in `time` of the signal; if all files began together, write "
            f"starts_at_zero = true."
        )
    return replace(parts[0], channels=tuple(channels), rows=max(part.rows for part in parts))
