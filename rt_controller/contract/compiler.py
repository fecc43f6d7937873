"""`compile_library`: C files to a shared library, with the C compiler of this machine.

The build of the package imports this file before the package is installed: it may import the
standard library and the error tree only.
"""

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rt_controller.contract.errors import MissingExtraError

FLAGS = ("-std=c99", "-O3", "-fPIC", "-shared", "-ffp-contract=off")
"""arithmetic as IEEE 754 has it: no fused or reordered operations"""
_NAMES = ("cc", "gcc", "clang")
_TIMEOUT_S = 300.0


class CompileError(Exception):
    """There is no C compiler, or it does not compile the files; the message has a remedy."""


def find_compiler() -> list[str]:
    """The command of the C compiler: $CC with its options, else cc, gcc, clang or package ziglang.

    Raises:
        CompileError: there is none.
    """
    chosen = shlex.split(os.environ.get("CC", ""))
    for program, *options in (chosen,) if chosen else ((name,) for name in _NAMES):
        path = shutil.which(program)
        if path is not None:
            return [path, *options]
    if not chosen and importlib.util.find_spec("ziglang") is not None:
        # Without a baseline, zig compiles for this very processor.
        return [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]
    found = f"CC={chosen[0]}, which is no program" if chosen else "none"
    raise CompileError(
        f"expected a C compiler, {', '.join(_NAMES)} or the one in $CC, found {found}. Install "
        f"one: apt-get install gcc libc6-dev (Debian, Ubuntu) or pip install ziglang"
    )


def compile_library(
    files: Sequence[Path], library: Path, headers: Path, options: Sequence[str] = ()
) -> None:
    """Compile the files into one shared library; a file of that name is replaced at once.

    `headers`: folder with further headers; `options` of the compiler, after `FLAGS`.

    Raises:
        CompileError: there is no C compiler, or it does not compile them.
        OSError: the library cannot be written.
    """
    compiler = find_compiler()
    part = library.with_name(f".{library.name}.{os.getpid()}")
    command = [*compiler, *FLAGS, *options, "-I", str(headers), "-o", str(part)]
    command += [*map(str, files), "-lm"]
    try:
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=_TIMEOUT_S
        )
        if done.returncode != 0:
            said = "\n".join(done.stderr.strip().splitlines()[:8])
            raise CompileError(
                f"{compiler[0]}: expected a C99 compiler with the headers of the C library, found "
                f"an error. Install the headers (Debian, Ubuntu: apt-get install libc6-dev) or "
                f"name another compiler in $CC. It said:\n{said}"
            )
        part.replace(library)
    except subprocess.TimeoutExpired as error:
        raise CompileError(f"{compiler[0]}: expected an end, found {error}.") from error
    finally:
        part.unlink(missing_ok=True)


def library_name(name: str, sources: Sequence[Path], text: str = "") -> str:
    """File name of a library of these sources, and of a text, for this kind of processor."""
    digest = hashlib.sha256(f"{FLAGS} {text}".encode())
    for file in sorted(sources):
        digest.update(file.read_bytes())
    return f"{name}-{platform.machine()}-{digest.hexdigest()[:16]}.so"


def remove_others(library: Path, name: str) -> None:
    """Remove libraries of this name and this kind of processor, of other sources."""
    for other in set(library.parent.glob(f"{name}-{platform.machine()}-*.so")) - {library}:
        other.unlink(missing_ok=True)


def built_library(
    what: str, name: str, folders: Sequence[Path], compile_into: Callable[[Path], Path]
) -> Path:
    """The library of that file name; compiled now, if it is in none of the folders.

    Raises:
        MissingExtraError: it is not compiled, and this machine cannot compile it.
    """
    for folder in folders:
        if (folder / name).exists():
            return folder / name
    problem = ""
    for folder in folders:
        try:
            return compile_into(folder)
        except OSError as error:
            problem = f"expected a folder that can be written, found {error}"
        except CompileError as error:
            problem = str(error)
            break
    raise MissingExtraError(f"The {what} is not compiled yet: {problem}.")
