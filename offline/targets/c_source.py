"""`--target c`: a folder with the control law as C source, its constants and test vectors."""

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

from offline.targets.recorded_drives import RecordedDrives, record_drives
from rt_controller.config import ControllerConfig
from rt_controller.contract.compiler import CompileError, find_compiler
from rt_controller.contract.errors import ArtifactError, ConfigError
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.bundle import Bundle
from rt_controller.native.compiler import SOURCES
from rt_controller.native.planner import NativePlanner
from rt_controller.native.source import model_source

Precision = Literal["float", "double"]
TEMPLATES = Path(__file__).with_name("c")
BUILD = "build"
"""folder of what `make` writes"""
CORTEX_M7 = "-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard"
"""options of arm-none-eabi-gcc"""


class Limits(NamedTuple):
    """Memory of the target in kB of 1024 bytes."""

    rom_kb: float = inf
    ram_kb: float = inf


class Sizes(NamedTuple):
    """Bytes, as a compiler makes them with -Os."""

    compiler: str
    constants_bytes: int
    code_bytes: int
    ram_bytes: int
    """struct and memory of a controller; the stack is not in it"""


def export_c(
    bundle: Bundle, config: ControllerConfig, output: Path, precision: Precision, limits: Limits
) -> tuple[dict[str, Any], list[str]]:
    """Figures of the law of a model and settings, and lines about them, after it was tested.

    The folder is written last, when the code has passed its tests.

    Raises:
        ArtifactError: the model cannot be driven with, its encoder is not a network, or the C code
            plans otherwise than the Python controller.
        ConfigError: settings that the C code does not know, a model beyond the limits, or a folder
            that cannot be written.
        MissingExtraError: law or simulated car are not compiled, and cannot be compiled.
    """
    law = NativePlanner(bundle, config.mpc, is_checked=False)
    problem = law.constants.problem
    with TemporaryDirectory() as work:
        folder = Path(work)
        _write_sources(folder, bundle, law, precision)
        make = _find_make()
        sizes = [] if make is None else _measure(folder, make)
        _require_within(sizes, limits)
        drives = record_drives(bundle, config, problem.stages)
        (folder / "recorded_drives.h").write_text(_drives_source(drives))
        tested = {} if make is None else _test(folder, make)
        lines = list(_figure_lines(sizes, tested))
        values = {
            "NAME": bundle.name,
            "SHA256": bundle.sha256,
            "REAL": precision,
            "PERIOD_MS": f"{1e3 * PERIOD_S:g}",
            "HORIZON_S": f"{problem.horizon * PERIOD_S:g}",
            "HOLD_PERIODS": str(law.constants.hold_periods),
            "MAX_ITERATIONS": str(problem.max_iterations),
            "FIGURES": "\n".join(f"- {line}" for line in lines),
        }
        _fill(folder / "README.md", values)
        try:
            ignored = shutil.ignore_patterns(BUILD)
            shutil.copytree(folder, output, dirs_exist_ok=True, ignore=ignored)
        except (OSError, shutil.Error) as error:
            raise ConfigError(
                f"--output: expected a folder with room for the source code, found {output}: "
                f"{error}. Name another one."
            ) from error
    figures = {
        "output": str(output),
        "model": bundle.name,
        "model_sha256": bundle.sha256,
        "precision": precision,
        "memory_numbers": law.memory_numbers,
        "sizes": [each._asdict() for each in sizes],
        "test": tested or None,
    }
    return figures, lines


def _write_sources(folder: Path, bundle: Bundle, law: NativePlanner, precision: Precision) -> None:
    for file in (*SOURCES.glob("*.[ch]"), *TEMPLATES.iterdir()):
        shutil.copyfile(file, folder / file.name)
    if precision == "float":  # for files of the user that are compiled without an option, too
        header = folder / "mdk.h"
        header.write_text(header.read_text().replace("define MDK_FLOAT 0", "define MDK_FLOAT 1"))
    head = f"/* Model {bundle.name}, SHA-256 {bundle.sha256}. */\n\n"
    (folder / "mdk_model.c").write_text(head + model_source(law.constants, "MDK_MODEL"))
    (folder / "mdk_model.h").write_text(
        f"{head}#ifndef MDK_MODEL_H\n#define MDK_MODEL_H\n\n"
        f'#include "mdk.h"\n\n'
        f"enum {{ MDK_MEMORY = {law.memory_numbers} }}; /* as mdk_memory(&MDK_MODEL) */\n"
        f"extern const mdk_model MDK_MODEL;\n\n#endif\n"
    )
    sources = sorted(file.name for file in folder.glob("*.c") if file.name != "test.c")
    for name in ("Makefile", "CMakeLists.txt"):
        _fill(folder / name, {"REAL": precision, "SOURCES": " ".join(sources)})


def _fill(file: Path, values: Mapping[str, str]) -> None:
    file.write_text(filled(file.read_text(), values))


def filled(text: str, values: Mapping[str, str]) -> str:
    """The text with a value in place of each @NAME@."""
    return re.sub("@([A-Z0-9_]+)@", lambda found: values[found[1]], text)


def _drives_source(drives: RecordedDrives) -> str:
    text = (
        "/* Situations, and what the Python controller planned in them. */\n\n"
        f"enum {{ RECORDED_PERIODS = {len(drives.plans)} }};\n"
    )
    names = ("RECORDED_IN", "RECORDED_COMMAND", "RECORDED_PLAN")
    for name, rows in zip(names, drives, strict=True):
        lines = (", ".join(f"{number:.10g}" for number in row) for row in rows.tolist())
        table = "},\n    {".join(lines)
        text += f"\nstatic const double {name}[][{rows.shape[1]}] = {{\n    {{{table}}}}};\n"
    return text


def _find_make() -> list[str] | None:
    """`make` with the C compiler of this machine; None: one of the tools is missing."""
    try:
        compiler = find_compiler()
    except CompileError:
        return None
    if not (shutil.which("make") and shutil.which("size")):
        return None
    return ["make", "-s", f"CC={shlex.join(compiler)}"]


def _run(folder: Path, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    # Options of a `make` that runs this program are not for this one.
    outside = {name: value for name, value in os.environ.items() if "MAKE" not in name}
    return subprocess.run(
        command, cwd=folder, env=outside, capture_output=True, text=True, check=False
    )


def _measure(folder: Path, make: Sequence[str]) -> list[Sizes]:
    """Sizes on this machine, and behind them on a Cortex-M7, if its compiler is installed."""
    targets = [("this machine", [*make, "CFLAGS=-Os"])]
    if shutil.which("arm-none-eabi-gcc") and shutil.which("arm-none-eabi-size"):
        tools = [f"{name.upper()}=arm-none-eabi-{name}" for name in ("ar", "size")]
        options = ["CC=arm-none-eabi-gcc", f"CFLAGS=-Os {CORTEX_M7}", *tools]
        targets.append(("Cortex-M7, arm-none-eabi-gcc", ["make", "-s", *options]))
    found: list[Sizes] = []
    for name, command in targets:
        out = f"{BUILD}/size{len(found)}"
        done = _run(folder, [*command, "size", f"OUT={out}"])
        if done.returncode != 0:
            raise ArtifactError(
                f"{name}: expected a compiler that makes the C code of the model, found an error. "
                f"Install its C library, or take it out of $PATH. It said:\n"
                f"{done.stderr.strip()[:800]}"
            )
        rows = [line.split() for line in done.stdout.splitlines()[1:]]
        parts = {Path(row[-1]).stem: int(row[3]) for row in rows}
        constants, ram = parts.pop("mdk_model"), parts.pop("ram")
        found.append(Sizes(name, constants, sum(parts.values()), ram))
    return found


def _require_within(sizes: Sequence[Sizes], limits: Limits) -> None:
    """Raise if the model, with the last of the compilers, needs more memory than there is.

    Raises:
        ConfigError: it does, or there is no compiler that tells.
    """
    if not sizes:
        if min(limits) < inf:
            raise ConfigError(
                "--rom-kb, --ram-kb: expected a C compiler with make and size, which tell what the "
                "code needs, found none. Install them, or leave the limits out."
            )
        return
    last = sizes[-1]
    parts = f"constants {_kb(last.constants_bytes)}, code {_kb(last.code_bytes)}"
    for option, limit, needed, what in (
        ("--rom-kb", limits.rom_kb, last.constants_bytes + last.code_bytes, parts),
        ("--ram-kb", limits.ram_kb, last.ram_bytes, "a controller without its stack"),
    ):
        if needed > 1024 * limit:
            raise ConfigError(
                f"{option} {limit:g}: expected a model that needs no more, found {_kb(needed)} "
                f"({what}; {last.compiler}). Export one with fewer latents or narrower layers "
                f"(offline-train --latents, --hidden), with --precision float, or plan over fewer "
                f"knots (mpc.knots in --config)."
            )


def _test(folder: Path, make: Sequence[str]) -> dict[str, float]:
    """Figures of `make test`.

    Raises:
        ArtifactError: it fails.
    """
    done = _run(folder, [*make, "test"])
    if done.returncode != 0:
        raise ArtifactError(
            f"The law in C: expected commands and plans of the Python controller, found others. "
            f"Report it with the model. `make test` said:\n{(done.stdout + done.stderr)[:800]}"
        )
    return {name: float(number) for name, number in map(str.split, done.stdout.splitlines())}


def _figure_lines(sizes: Sequence[Sizes], tested: Mapping[str, float]) -> Iterator[str]:
    for each in sizes:
        yield (
            f"{each.compiler}: constants {each.constants_bytes} bytes, code {each.code_bytes} "
            f"bytes (-Os), RAM of a controller {each.ram_bytes} bytes"
        )
    if not tested:
        yield "not measured: there was no C compiler with make and size"
        return
    yield (
        f"QP iterations: {tested['iterations_worst']:.0f} at most, median "
        f"{tested['iterations_median']:.0f}, in {tested['periods']:.0f} recorded periods"
    )
    yield (
        f"largest difference: {tested['command_difference']:.1e} of an input's range in the "
        f"command, {tested['plan_difference']:.1e} in the plan (at most {tested['tolerance']:.0e})"
    )
    yield f"stack: {tested['stack_bytes']:.0f} bytes on this machine"


def _kb(size_bytes: int) -> str:
    return f"{size_bytes / 1024:.1f} kB"
