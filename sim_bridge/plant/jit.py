"""The one door to the compiler: every numeric kernel of the car is decorated here.

Kernels release the interpreter lock and are cached on disk. The compiler checks only a kernel's
own file when it looks into its cache, yet kernels are compiled together with what they call; so
the cache lives in a folder named after the text of all files that hold kernels, and a change in
one of them is never answered with old machine code.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

_ROOM = Path(__file__).parent
_CONFIG: Any = numba.config


def compiled(function: Kernel) -> Kernel:
    """The same function as machine code, compiled at its first call and then kept on disk."""
    outer = _CONFIG.CACHE_DIR
    _CONFIG.CACHE_DIR = str(_cache_folder(outer) / f"kernels-{_SOURCES_DIGEST}")
    try:
        kernel = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    finally:
        _CONFIG.CACHE_DIR = outer
    return cast(Kernel, kernel)


def _cache_folder(chosen: str) -> Path:
    """Where the user wants it, else beside the sources, else (installed read-only) at home."""
    if chosen:
        return Path(chosen)
    if os.access(_ROOM, os.W_OK):
        return _ROOM / "__pycache__"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "rt-controller"


def _digest_of_sources() -> str:
    sources = [*sorted(_ROOM.glob("*.py")), _ROOM.parent / "frenet.py"]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]


_SOURCES_DIGEST = _digest_of_sources()
