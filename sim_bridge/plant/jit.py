"""`compiled`: the numba decorator of all numeric kernels of the car.

Kernels release the interpreter lock and are cached on disk. numba compares only a kernel's own file
with its cache, but compiles a kernel together with the kernels that it calls. Therefore the cache
folder is named after the content of all files with kernels: a change in any of them recompiles all.
"""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, TypeVar, cast

import numba

from rt_controller.contract.user_cache import user_cache_folder

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_FOLDER = Path(__file__).parent
_CONFIG: Any = numba.config


def compiled(function: Kernel) -> Kernel:
    """The function as machine code, compiled at its first call and cached on disk if possible."""
    outer = _CONFIG.CACHE_DIR
    folder = _cache_folder(outer)
    if folder is not None:
        _CONFIG.CACHE_DIR = str(folder / f"kernels-{_SOURCES_DIGEST}")
    try:
        kernel = numba.njit(cache=folder is not None, nogil=True, error_model="numpy")(function)
    finally:
        _CONFIG.CACHE_DIR = outer
    return cast(Kernel, kernel)


def uncompiled(kernel: Kernel) -> Kernel:
    """The Python function behind a kernel, for a single call that is not worth compiling."""
    return cast(Kernel, cast(Any, kernel).py_func)


@cache
def _cache_folder(configured: str) -> Path | None:
    """NUMBA_CACHE_DIR, else beside the sources, else (read-only installation) the user's cache.

    None if no file can be written in any of them: then every process compiles for itself.
    """
    folders = [Path(configured)] if configured else [_FOLDER / "__pycache__"]
    for folder in filter(None, (*folders, user_cache_folder())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=folder) as file:  # a full disk too is found only by writing
                file.write(bytes(1))
        except OSError:
            continue
        return folder
    return None


def _digest_of_sources() -> str:
    sources = [*sorted(_FOLDER.rglob("*.py")), _FOLDER.parent / "frenet.py"]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


_SOURCES_DIGEST = _digest_of_sources()
