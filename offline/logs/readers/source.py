"""Files of logs: which there are, and which reader reads each."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from offline.data.manifest import SourceFile
from offline.logs.mapping import LogMapping
from offline.logs.readers.array_log import read_mat, read_npz
from offline.logs.readers.csv_log import CSV_SUFFIXES, read_csv
from offline.logs.readers.log import Log
from offline.logs.readers.mf4_log import read_mf4
from offline.logs.readers.parquet_log import read_parquet
from rt_controller.contract.errors import ConfigError, DatasetError

_TABLE_READERS = {".npz": read_npz, ".mat": read_mat, ".parquet": read_parquet, ".pq": read_parquet}
_MF4_SUFFIXES = (".mf4", ".mdf", ".dat")
_CAN_SUFFIXES = (".blf", ".asc", ".log", ".trc")
SUFFIXES = (*CSV_SUFFIXES, *_TABLE_READERS, *_MF4_SUFFIXES, *_CAN_SUFFIXES)


def find_logs(places: Sequence[Path], mapping: LogMapping) -> list[Path]:
    """The logs among these files and in these folders, sorted by name within a folder.

    A reference line in the same folder is not a log.

    Raises:
        ConfigError: a place does not exist, has an unknown ending, or a name occurs twice.
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
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigError(
            f"expected logs with different names, because the split and the messages use the name, "
            f"found twice: {', '.join(repeated)}. Rename or leave out."
        )
    return found


def read_log(path: Path, mapping: LogMapping) -> Log:
    """The columns of the mapping, read from a log.

    Raises:
        DatasetError: the log or its DBC is missing, damaged, truncated or of a version that cannot
            be read; a column is missing, ambiguous or has no numbers; time is missing, runs
            backwards or has another period than the mapping; a frame is shorter than its message.
        MissingExtraError: the package that reads such logs is not installed.
    """
    name, wanted = path.name.lower(), mapping.columns
    read_table = _TABLE_READERS.get(path.suffix.lower())
    if read_table is not None:
        return read_table(path, wanted, mapping.time)
    if name.endswith(_MF4_SUFFIXES):
        return read_mf4(path, wanted)
    if name.endswith(_CAN_SUFFIXES):
        # python-can and cantools are imported for such logs only.
        from offline.logs.readers.can_log import read_can

        return read_can(path, wanted, mapping.can)
    return read_csv(path, wanted, mapping.time, mapping.csv)


def source_file(path: Path) -> SourceFile:
    """Name and SHA-256 of a file that the data set was made from."""
    with path.open("rb") as file:
        return SourceFile(path.name, hashlib.file_digest(file, "sha256").hexdigest())


def _is_log(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(SUFFIXES)
