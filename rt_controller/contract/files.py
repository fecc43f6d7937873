"""Files that are replaced as a whole, and npz archives that are read completely.

numpy stops reading an archive member at its last number, which may be before the checksum is
compared. Here every member is read to its end first, so a flipped bit in the numbers is always
noticed.
"""

import codecs
import errno
import io
import os
import shutil
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

LARGEST_TEXT_BYTES = 64_000_000


@contextmanager
def atomic_write(file: Path) -> Iterator[BinaryIO]:
    """A stream whose content replaces the file when the block ends without an exception.

    Until then, and after an exception or a crash, the file is unchanged. Several processes may
    write the same file; the last one to finish wins. A link stays one: the file that it leads to is
    replaced. /dev/stdout, and files in a folder that takes no new ones, are written in place.

    Raises:
        OSError: the file cannot be written.
    """
    target = Path(os.path.realpath(file))
    in_place = _is_written_in_place(file, target)
    written = file if in_place else target.with_name(f".{uuid4().hex}.part")
    try:
        with written.open("wb") as stream:
            yield stream
        if not in_place:
            with suppress(OSError):  # there is none before, or it belongs to another user
                shutil.copymode(target, written)
            os.replace(written, target)
    except OSError as error:
        if error.filename in (None, str(written)):
            error.filename = str(file)
        raise
    finally:
        if not in_place:
            written.unlink(missing_ok=True)


def write_text(file: Path, text: str) -> None:
    """Replace the content of the file by this text, as `atomic_write`.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_write(file) as stream:
        stream.write(text.encode())


def _is_written_in_place(file: Path, target: Path) -> bool:
    if file.absolute().parts[1:2] in (("dev",), ("proc",)):  # /dev/stdout may lead to a file
        return True
    return target.exists() and not os.access(target.parent, os.W_OK | os.X_OK)


class DamagedArchiveError(ValueError):
    """Bytes that are not an npz archive, or not the one that was written."""


def open_regular(path: Path, largest_bytes: int | None = None) -> BinaryIO:
    """An open file; pipes and devices, which may be endless or never answer, are not waited for.

    Raises:
        OSError: there is no such file, it is no regular one, or it is larger than `largest_bytes`.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    found = os.fstat(descriptor)
    if stat.S_ISREG(found.st_mode) and found.st_size <= (largest_bytes or found.st_size):
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    raise OSError(errno.EFBIG, _too_large(largest_bytes or 0, found.st_size), str(path))


def read_text(path: Path, errors: str = "strict") -> str:
    """The text of a file in UTF-8, or in UTF-16 with its byte order mark, with any line ends.

    Raises:
        OSError: it cannot be opened, is no regular file, or is larger than `LARGEST_TEXT_BYTES`.
        UnicodeDecodeError: it is not UTF-8, and `errors` is "strict".
    """
    with open_regular(path, LARGEST_TEXT_BYTES) as file:
        is_utf16 = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        file.seek(0)
        with io.TextIOWrapper(file, "utf-16" if is_utf16 else "utf-8-sig", errors) as text:
            return text.read()


def _too_large(largest_bytes: int, found_bytes: int) -> str:
    return f"{found_bytes / 1e6:.0f} MB, where at most {largest_bytes / 1e6:.0f} MB are read"


def read_arrays(
    path: Path, largest_bytes: int | None = None, largest_unpacked_bytes: int | None = None
) -> dict[str, NDArray[Any]]:
    """The arrays of an npz archive by name; pickles are never loaded.

    Args:
        path: of the archive.
        largest_bytes: of the file; None: no limit.
        largest_unpacked_bytes: of all its members; None: no limit.

    Raises:
        OSError: there is no file that can be opened, or it is too large.
        DamagedArchiveError: it is truncated, altered, or something else, or too large.
    """
    with open_regular(path, largest_bytes) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                size = sum(member.file_size for member in archive.infolist())
                if largest_unpacked_bytes is not None and size > largest_unpacked_bytes:
                    raise DamagedArchiveError(_too_large(largest_unpacked_bytes, size))
                return {
                    name.removesuffix(".npy"): np.lib.format.read_array(
                        io.BytesIO(archive.read(name)), allow_pickle=False
                    )
                    for name in archive.namelist()
                }
        # zipfile, zlib and numpy's header parser raise many types, few of them documented.
        except Exception as error:
            raise DamagedArchiveError(str(error) or type(error).__name__) from error


def user_cache_folder() -> Path | None:
    """The folder of this project, made if needed; None where nothing can be written.

    A system account may have no home, and the home of a container may be read-only.
    """
    try:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = base / "rt-controller"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: the user has no home
        return None
    return folder if os.access(folder, os.W_OK | os.X_OK) else None
