"""Arrays in an npz archive, read with suspicion: all of what was written, or nothing.

numpy stops reading a member at its last number, which may be before the checksum is compared.
Here every member is read to its end first, so a flipped bit in the numbers is always noticed.
"""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class DamagedArchiveError(ValueError):
    """Bytes that are no npz archive, or no longer the one that was written."""


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive by name; pickles are never opened.

    Raises:
        OSError: there is no file that can be opened.
        DamagedArchiveError: it is truncated, altered, or something else.
    """
    with path.open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                return {
                    name.removesuffix(".npy"): _read_array(archive.read(name))
                    for name in archive.namelist()
                }
        # zipfile, zlib, the tokenizer behind numpy's headers: a dozen types, few of them promised.
        except Exception as error:
            raise DamagedArchiveError(str(error) or type(error).__name__) from error


def _read_array(member: bytes) -> NDArray[Any]:
    array: NDArray[Any] = np.lib.format.read_array(io.BytesIO(member), allow_pickle=False)
    return array
