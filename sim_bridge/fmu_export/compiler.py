"""`compile_library`: C files to a shared library, with the C compiler of this machine."""

import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from rt_controller.contract.errors import ConfigError, MissingExtraError

_NAMES = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off")
"""arithmetic as IEEE 754 and numba do it: no fused or reordered operations"""
_TIMEOUT_S = 300.0


def find_compiler() -> list[str]:
    """The command of the C compiler: $CC, which may have options, or the first of cc, gcc, clang.

    Raises:
        MissingExtraError: there is none.
    """
    chosen = shlex.split(os.environ.get("CC", ""))
    for program, *options in (chosen,) if chosen else ((name,) for name in _NAMES):
        path = shutil.which(program)
        if path is not None:
            return [path, *options]
    found = f"CC={chosen[0]}, which is no program" if chosen else "none"
    raise MissingExtraError(
        f"export-fmu needs a C compiler: expected {', '.join(_NAMES)} or the one in $CC, found "
        f"{found}. Install one; on Debian and Ubuntu: apt-get install gcc libc6-dev"
    )


def compile_library(
    files: Sequence[Path], library: Path, further_flags: Sequence[str] = ()
) -> None:
    """Compile the files into one shared library.

    Raises:
        MissingExtraError: there is no C compiler.
        ConfigError: it does not compile them.
    """
    compiler = find_compiler()
    command = [*compiler, *FLAGS, *further_flags, "-o", str(library), *map(str, files), "-lm"]
    try:
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=_TIMEOUT_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(
            f"{compiler[0]}: expected a C99 compiler, found an error: {error}. Name another in $CC."
        ) from error
    if done.returncode != 0:
        said = "\n".join(done.stderr.strip().splitlines()[:8])
        raise ConfigError(
            f"{compiler[0]}: expected a C99 compiler with the headers of the C library, found an "
            f"error. Install the headers (Debian and Ubuntu: apt-get install libc6-dev) or name "
            f"another compiler in $CC. It said:\n{said}"
        )
