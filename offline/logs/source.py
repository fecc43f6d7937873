"""Files of logs: which there are, and who reads each."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from offline.logs import array_log, csv_log, mf4_log, parquet_log
from offline.logs.array_log import read_mat, read_npz
from offline.logs.csv_log import read_csv
from offline.logs.log import Log
from offline.logs.mapping import Mapping
from offline.logs.mf4_log import read_mf4
from offline.logs.parquet_log import read_parquet
from offline.manifest import SourceFile
from rt_controller.contract.errors import ConfigError, DatasetError

CAN_SUFFIXES = (".blf", ".asc", ".log", ".trc")
SUFFIXES = (
    *csv_log.SUFFIXES,
    *(plain + packed for plain in csv_log.SUFFIXES for packed in csv_log.PACKED_SUFFIXES),
    *array_log.NPZ_SUFFIXES,
    *array_log.MAT_SUFFIXES,
    *parquet_log.SUFFIXES,
    *mf4_log.SUFFIXES,
    *CAN_SUFFIXES,
)


def find_logs(places: Sequence[Path], mapping: Mapping) -> list[Path]:
    """The logs among these files and in these folders, sorted by name within a folder.

    A reference line that lies beside the logs is none of them.

    Raises:
        ConfigError: a place does not exist, is of an unknown kind, or is named twice.
        DatasetError: a folder has no logs.
    """
    line = mapping.pose and mapping.pose.reference_line
    found: list[Path] = []
    for place in places:
        if place.is_dir():
            inside = [path for path in sorted(place.iterdir()) if _is_log(path)]
            if line and line.exists():
                inside = [path for path in inside if not path.samefile(line)]
            if not inside:
                raise DatasetError(
                    f"{place}: expected logs ({', '.join(SUFFIXES)}), found a folder without any. "
                    f"Name another folder, or the files themselves."
                )
            found += inside
        elif not place.is_file():
            raise ConfigError(f"{place}: expected a log or a folder of logs, found nothing.")
        elif not _is_log(place):
            raise ConfigError(
                f"{place}: expected a log of a known kind ({', '.join(SUFFIXES)}), found another "
                f"ending. Export it to one of these."
            )
        else:
            found.append(place)
    names = [path.name for path in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigError(
            f"expected logs with names of their own, since the split and the messages go by name, "
            f"found twice: {', '.join(twice)}. Rename or leave out."
        )
    return found


def read_log(path: Path, mapping: Mapping) -> Log:
    """The columns of the mapping, read from a log.

    Raises:
        DatasetError: the log is damaged, or does not have them.
        MissingExtraError: the library that reads such logs is not installed.
    """
    wanted, suffix = mapping.columns, path.suffix.lower()
    if suffix in array_log.NPZ_SUFFIXES:
        return read_npz(path, wanted, mapping.time)
    if suffix in array_log.MAT_SUFFIXES:
        return read_mat(path, wanted, mapping.time)
    if suffix in parquet_log.SUFFIXES:
        return read_parquet(path, wanted, mapping.time)
    if suffix in mf4_log.SUFFIXES:
        return read_mf4(path, wanted)
    if suffix in CAN_SUFFIXES:
        # python-can and cantools are loaded for such logs only.
        from offline.logs.can_log import read_can

        return read_can(path, wanted, mapping.can)
    return read_csv(path, wanted, mapping.time, mapping.csv)


def describe_source(path: Path) -> SourceFile:
    """Name and hash of a file that went into the data set."""
    with path.open("rb") as file:
        return SourceFile(path.name, hashlib.file_digest(file, "sha256").hexdigest())


def _is_log(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(SUFFIXES)
