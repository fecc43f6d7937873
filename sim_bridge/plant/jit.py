"""`compiled`: the numba decorator of all numeric kernels of the car.

Kernels release the interpreter lock and are cached on disk. numba compares only a kernel's own file
with its cache, but compiles a kernel together with the kernels that it calls. Therefore the cache
folder is named after the content of all files with kernels: a change in any of them recompiles all.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_FOLDER = Path(__file__).parent
_CONFIG: Any = numba.config


def compiled(function: Kernel) -> Kernel:
    """The function as machine code, compiled at its first call and cached on disk."""
    outer = _CONFIG.CACHE_DIR
    _CONFIG.CACHE_DIR = str(_cache_folder(outer) / f"kernels-{_SOURCES_DIGEST}")
    try:
        kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        _CONFIG.CACHE_DIR = outer
    return cast(Kernel, kernel)


def uncompiled(kernel: Kernel) -> Kernel:
    """The Python function behind a kernel, for a single call that is not worth compiling."""
    return cast(Kernel, cast(Any, kernel).py_func)


def _cache_folder(configured: str) -> Path:
    """NUMBA_CACHE_DIR, else beside the sources, else (read-only installation) the user's cache."""
    if configured:
        return Path(configured)
    if os.access(_FOLDER, os.W_OK):
        return _FOLDER / "__pycache__"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rt-controller"


def _digest_of_sources() -> str:
    sources = [*sorted(_FOLDER.rglob("*.py")), _FOLDER.parent / "frenet.py"]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


_SOURCES_DIGEST = _digest_of_sources()
