"""`koopman.npz`, field by field: whatever is not what it should be is refused."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.archive import DamagedArchiveError, read_arrays
from rt_controller.contract.errors import ArtifactError


@dataclass(frozen=True, slots=True)
class KoopmanFile:
    """The arrays of a file, each taken as what it should be or refused with an `ArtifactError`."""

    path: Path
    arrays: Mapping[str, NDArray[Any]]

    def require(self, key: str, expected: object) -> None:
        """Return if that field holds exactly this number, word or tuple of words."""
        found = self._take(key).tolist()
        check_field(self.path, key, expected, tuple(found) if isinstance(found, list) else found)

    def text(self, key: str) -> str:
        """The one text of that field."""
        array = self._take(key)
        if array.shape != () or array.dtype.kind != "U":
            raise self._refusal(f"one text in {key}", array)
        return str(array)

    def words(self, key: str) -> tuple[str, ...]:
        """The texts of that field, in order; there may be none."""
        array = self._take(key)
        if array.ndim != 1 or array.dtype.kind != "U":
            raise self._refusal(f"a list of texts in {key}", array)
        return tuple(array.tolist())

    def number(self, key: str) -> float:
        """The one finite number of that field."""
        return float(self.numbers(key, 0))

    def count(self, key: str) -> int:
        """The one whole number of that field."""
        array = self._take(key)
        if array.shape != () or array.dtype != np.int64:
            raise self._refusal(f"one whole number in {key}", array)
        return int(array)

    def numbers(self, key: str, dimensions: int) -> NDArray[np.float64]:
        """The numbers of that field, all finite, in C order."""
        array = self._take(key)
        if array.dtype != np.float64 or array.ndim != dimensions:
            raise self._refusal(f"float64 numbers in {dimensions} dimensions in {key}", array)
        if not np.all(np.isfinite(array)):
            raise ArtifactError(
                f"{self.path}: expected finite numbers in {key}, found "
                f"{np.count_nonzero(~np.isfinite(array))} that are not. Run offline-export again."
            )
        return np.asarray(array, order="C")

    def _take(self, key: str) -> NDArray[Any]:
        if key not in self.arrays:
            raise ArtifactError(
                f"{self.path}: expected a field {key!r}, found {sorted(self.arrays)}. "
                f"Run offline-export again."
            )
        return self.arrays[key]

    def _refusal(self, expected: str, found: NDArray[Any]) -> ArtifactError:
        return ArtifactError(
            f"{self.path}: expected {expected}, found {found.dtype} of shape {found.shape}. "
            f"Run offline-export again."
        )


def read_koopman(path: Path) -> KoopmanFile:
    """The file, its bytes checked and its fields not yet.

    Raises:
        ArtifactError: it is missing, truncated, altered, or no npz archive without pickles.
    """
    try:
        return KoopmanFile(path, read_arrays(path))
    except OSError as error:
        raise ArtifactError(
            f"{path}: expected the matrices of a model bundle, found nothing readable "
            f"({error.strerror}). Point --model at a folder that offline-export wrote."
        ) from error
    except DamagedArchiveError as error:
        raise ArtifactError(
            f"{path}: expected an npz archive without pickles, found something else, or a "
            f"truncated or altered file ({error}). Run offline-export again."
        ) from error


def check_field(path: Path, key: str, expected: object, found: object) -> None:
    """Return if both are equal.

    Raises:
        ArtifactError: they are not.
    """
    if expected != found:
        raise ArtifactError(
            f"{path}: expected {key} = {expected}, found {found!s:.200}. This bundle was made for "
            f"another controller: run offline-export of the same version."
        )
