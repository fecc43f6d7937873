"""Files that are replaced as a whole, and npz archives that are read completely.

numpy stops reading an archive member at its last number, which may be before the checksum is
compared. Here every member is read to its end first, so a flipped bit in the numbers is always
noticed.
"""

import io
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray


@contextmanager
def atomic_write(file: Path) -> Iterator[BinaryIO]:
    """A stream whose content replaces the file when the block ends without an exception.

    Until then, and after an exception or a crash, the file is unchanged. Several processes may
    write the same file; the last one to finish wins.
    """
    part = file.with_name(f".{file.name}.{uuid4().hex}.part")
    try:
        with part.open("wb") as stream:
            yield stream
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


class DamagedArchiveError(ValueError):
    """Bytes that are not an npz archive, or not the one that was written."""


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an npz archive by name; pickles are never loaded.

    Raises:
        OSError: there is no file that can be opened.
        DamagedArchiveError: it is truncated, altered, or something else.
    """
    with path.open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                return {
                    name.removesuffix(".npy"): np.lib.format.read_array(
                        io.BytesIO(archive.read(name)), allow_pickle=False
                    )
                    for name in archive.namelist()
                }
        # zipfile, zlib and numpy's header parser raise many types, few of them documented.
        except Exception as error:
            raise DamagedArchiveError(str(error) or type(error).__name__) from error
