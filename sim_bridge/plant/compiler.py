"""`compile_library`: C files to a shared library, with the C compiler of this machine.

`compile_car` does so with the simulated car, into a file that is named after its sources. The
build of the package loads this file by its path, before the package is installed: it may import the
standard library only.
"""

import ast
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off")
"""arithmetic as IEEE 754 has it: no fused or reordered operations"""
SOURCES = Path(__file__).with_name("c")
BUILT = Path(__file__).with_name("built")
"""where the compiled car is, in an installation and in a checkout"""
_RECORDS = ("parts.py", "tyre_file.py", "parameters.py", "states.py", "protocol.py")
"""files whose named tuples `…Parameters` are the numbers of a car"""
_STRUCTS = {"StateIndex": "State", "PlantOutputs": "Outputs"}
"""by the other named tuples that the compiler gets"""
_ARRAYS = {"Ratios": "[N_GEARS]", "Efficiencies": "[N_GEARS]", "MapTorques": "[N_MAP][N_MAP]"}
_OF_FILE = {"_FromTyreFile": "TyreFileParameters"}
_ARRAYS |= {"MapSpeeds": "[N_MAP]", "MapPedals": "[N_MAP]", "PerWheel": "[N_WHEELS]"}
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


def records_header() -> str:
    """`records.h`: the named tuples of a car as structs of doubles, fields in their order.

    So the record that `car_record` makes is passed to C as it is. Four fields of the wheels in
    their order, such as `load_front_left_n`, are one array, `load_n`.
    """
    texts = (Path(__file__).with_name(name).read_text("utf-8") for name in _RECORDS)
    nodes = (node for text in texts for node in ast.parse(text).body)
    lines = ["/* Made from the named tuples of sim_bridge/plant. */", "#pragma once"]
    for name, fields in map(_record, nodes):
        if isinstance(fields, int):
            lines.append(f"#define {name} {fields}")
            continue
        if not name.endswith("Parameters") and name not in _STRUCTS:
            continue
        lines.append("typedef struct {")
        for field, annotation in fields:
            if "_front_right_" in field or "_rear_left_" in field or "_rear_right_" in field:
                continue
            kind = _OF_FILE.get(annotation, annotation).removeprefix("parts.")
            size = _ARRAYS.get("PerWheel" if "_front_left_" in field else kind, "")
            c_type = kind if kind.endswith("Parameters") else "double"
            lines.append(f"{c_type} {field.replace('_front_left_', '_')}{size};")
        lines.append(f"}} {_STRUCTS.get(name, name)};")
    return "\n".join((*lines, ""))


def _record(node: ast.stmt) -> tuple[str, list[tuple[str, str]] | int]:
    """Name, and fields with their annotations, of a named tuple; a size `N_…`; else no name."""
    if isinstance(node, ast.ClassDef):
        fields = [each for each in node.body if isinstance(each, ast.AnnAssign)]
        found = [(ast.unparse(each.target), ast.unparse(each.annotation)) for each in fields]
        return node.name, found
    name = ast.unparse(node.targets[0]) if isinstance(node, ast.Assign) else ""
    if isinstance(node, ast.Assign) and name.startswith("N_"):
        is_number = isinstance(node.value, ast.Constant)
        return (name, int(ast.literal_eval(node.value))) if is_number else ("", [])
    if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("namedtuple("):
        name, names = (ast.literal_eval(each) for each in node.value.args)  # type: ignore[attr-defined]
        return name, [(each, "Number") for each in names.split()]
    return "", []


def compile_library(files: Sequence[Path], library: Path, headers: Path = SOURCES) -> None:
    """Compile the files into one shared library; a file of that name is replaced at once.

    `headers`: folder with further headers.

    Raises:
        CompileError: there is no C compiler, or it does not compile them.
        OSError: the library cannot be written.
    """
    compiler = find_compiler()
    part = library.with_name(f".{library.name}.{os.getpid()}")
    command = [*compiler, *FLAGS, "-I", str(headers), "-o", str(part), *map(str, files), "-lm"]
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


def car_library_name() -> str:
    """File name of the car that is compiled from the present sources for this kind of processor."""
    digest = hashlib.sha256(f"{FLAGS} {records_header()}".encode())
    for file in sorted(SOURCES.iterdir()):
        digest.update(file.read_bytes())
    return f"car-{platform.machine()}-{digest.hexdigest()[:16]}.so"


def compile_car(folder: Path) -> Path:
    """Compile the car into a folder, unless it is there; cars of other sources are removed.

    Raises:
        CompileError: there is no C compiler, or it does not compile them.
        OSError: the folder cannot be written.
    """
    library = folder / car_library_name()
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as headers:
            Path(headers, "records.h").write_text(records_header(), "utf-8")
            compile_library(sorted(SOURCES.glob("*.c")), library, Path(headers))
        for other in set(folder.glob(f"car-{platform.machine()}-*.so")) - {library}:
            other.unlink(missing_ok=True)
    return library
