"""Where fitted rivals are kept, so that nobody waits for them twice.

A fitted rival is a frozen dataclass of arrays and plain numbers, and so is its file: an npz
archive without pickles. The file's name holds a digest of everything the fit follows from: the
numbers of the data set, the settings, and the code of this package that the rival is made by.
"""

import ast
import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from offline.baselines.finding import Finding
from offline.predictor import Array
from rt_controller.contract.archive import DamagedArchiveError, read_arrays
from rt_controller.contract.errors import ArtifactError

_FIT_CPU_S = "_fit_cpu_s"
_PACKAGE = Path(__file__).parents[1]


class FittedRival(Protocol):
    """A rival after its fit: a frozen dataclass that predicts."""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """As `offline.predictor.Predictor`."""
        ...

    def findings(self) -> tuple[Finding, ...]:
        """What the fit chose and found, for people: name and value."""
        ...


Rival = TypeVar("Rival", bound=FittedRival)


class Kept(NamedTuple):
    """A rival from the shelf."""

    rival: FittedRival
    fit_cpu_s: float
    """CPU time that the fit took, whenever that was"""


def place(
    folder: Path, name: str, data_sha256: str, settings: object, modules: Iterable[str]
) -> Path:
    """The file of a rival that these modules fit to these data with these settings, a dataclass."""
    words = [name, data_sha256, asdict(settings), digest_of_modules(modules)]  # type: ignore[call-overload]
    digest = hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()
    return folder / f"{name}-{digest[:16]}.npz"


def keep(path: Path, kept: Kept) -> None:
    """Write the file, whole or not at all.

    Raises:
        ArtifactError: the folder has no room.
    """
    rival: Any = kept.rival
    arrays: dict[str, NDArray[Any]] = {
        field.name: np.asarray(getattr(rival, field.name)) for field in fields(rival)
    }
    part = path.with_name(f"{path.name}.{uuid4().hex}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.savez(file, **arrays, **{_FIT_CPU_S: np.float64(kept.fit_cpu_s)})  # type: ignore[arg-type]
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise ArtifactError(
            f"{path}: expected room for a fitted rival, found: {error.strerror}. Free some space."
        ) from error


def recall(path: Path, kind: type[Rival]) -> Kept | None:
    """The rival in that file, None if there is none.

    Raises:
        ArtifactError: the file is truncated, altered or of another kind.
    """
    try:
        arrays = read_arrays(path)
        fit_cpu_s = float(arrays.pop(_FIT_CPU_S))
        return Kept(kind(**_plain(arrays)), fit_cpu_s)
    except FileNotFoundError:
        return None
    except (OSError, DamagedArchiveError, KeyError, TypeError, ValueError) as error:
        raise ArtifactError(
            f"{path}: expected a fitted rival, found a truncated or foreign file ({error}). "
            f"Delete it, and the rival is fitted again."
        ) from error


def _plain(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Single numbers and words as such, everything else as arrays."""
    return {name: array.item() if array.ndim == 0 else array for name, array in arrays.items()}


def digest_of_modules(names: Iterable[str]) -> str:
    """Hash of what these modules do, and all of this package that they import."""
    trees: dict[str, ast.Module] = {}
    left = sorted(set(names))
    while left:
        name = left.pop()
        path = _PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py")
        if name in trees or not (name.startswith(_PACKAGE.name + ".") and path.is_file()):
            continue
        trees[name] = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(trees[name]):
            if isinstance(node, ast.ImportFrom):
                left.append(str(node.module))
                left += [f"{node.module}.{alias.name}" for alias in node.names]
    words = [f"{name} {digest_of_code(trees[name])}" for name in sorted(trees)]
    return hashlib.sha256("\n".join(words).encode()).hexdigest()


def digest_of_code(tree: ast.Module) -> str:
    """Hash of what a file does: comments, docstrings and layout do not count."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [line for line in node.body if not _is_docstring(line)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def _is_docstring(line: ast.stmt) -> bool:
    return (
        isinstance(line, ast.Expr)
        and isinstance(line.value, ast.Constant)
        and isinstance(line.value.value, str)
    )
