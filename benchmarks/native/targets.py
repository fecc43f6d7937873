"""The exported C code on other processors, with sanitizers, and what its objects need."""

import re
import shutil
import subprocess
from pathlib import Path

from offline.targets.c_source import CORTEX_M7, Limits, export_c
from rt_controller.config import ControllerConfig
from rt_controller.model.bundle import Bundle

Figures = dict[str, float | bool | None]
HERE = Path(__file__).parent
STRICT = "-O2 -c -Wall -Wextra -Wshadow -Wconversion -pedantic -Werror"
SANITIZED = "-O2 -g -fsanitize=address,undefined -fno-sanitize-recover=all"
EMULATOR = ("-M", "mps2-an500", "-nographic", "-icount", "shift=0", "-semihosting", "-kernel")
"""a Cortex-M7 whose clock counts instructions"""
FORBIDDEN = re.compile(r"(m|c|re)alloc|free|\w*printf|puts|fopen|exit|abort")
_LAW_ALONE = """#include "mdk_model.h"
mdk_controller c;
mdk_real memory[MDK_MEMORY];
mdk_situation now;
mdk_real command[MDK_INPUTS];
void start(void);
void start(void) {
    mdk_init(&c, &MDK_MODEL, memory);
    mdk_step(&c, &now, command);
}
"""
"""all that a device with the law has in its memory"""


class Export:
    """A folder of `offline-export --target c` in float, and its programs on several processors."""

    def __init__(self, bundle: Bundle, folder: Path) -> None:
        export_c(bundle, ControllerConfig(), folder, "float", Limits())
        self._law = [file.name for file in sorted(folder.glob("*.c")) if file.name != "test.c"]
        for file in (HERE / "fuzz.c", *(HERE / "cortex_m7").iterdir()):
            shutil.copyfile(file, folder / file.name)
        (folder / "law_alone.c").write_text(_LAW_ALONE)
        self._folder = folder

    def cortex_m7(self) -> Figures:
        """Instructions and stack of a period on a Cortex-M7, and memory of the law alone."""
        compiler, fused = "arm-none-eabi-gcc", "-O2 -ffp-contract=fast"
        options = f"{fused} {CORTEX_M7} -nostartfiles -T link.ld --specs"
        test = self._build(compiler, f"{options}=rdimon.specs", "start.c")
        law = self._build(compiler, f"{options}=nosys.specs", "law_alone.c")
        sizes = self._run("arm-none-eabi-size", law).splitlines()[1].split()
        text, data, bss = map(int, sizes[:3])
        found = _read(self._run("qemu-system-arm", *EMULATOR, test))
        return {
            "instructions_first_worst": found["instructions_first_worst"],
            "instructions_worst": found["instructions_worst"],
            "instructions_median": found["instructions_median"],
            "plan_difference_of_range": found["plan_difference"],
            "stack_bytes": found["stack_bytes"],
            "rom_bytes": text + data,
            "ram_bytes": data + bss + found["stack_bytes"],
        }

    def aarch64(self, periods: int) -> Figures:
        """The test of the folder, and whether commands of random periods are those of x86-64."""
        cross = "aarch64-linux-gnu-gcc"
        found = _read(self._run("qemu-aarch64", self._build(cross, "-O2 -static", "test.c")))
        commands = [
            self._run(*emulator, self._build(compiler, options, "fuzz.c"), str(periods))
            for emulator, compiler, options in (
                ((), "cc", "-O2"),
                ((), "cc", "-O3"),
                (("qemu-aarch64",), cross, "-O2 -static"),
            )
        ]
        return {
            "plan_difference_of_range": found["plan_difference"],
            "is_o3_bit_identical": commands[0] == commands[1],
            "is_aarch64_bit_identical": commands[0] == commands[2],
        }

    def sanitized(self, periods: int) -> Figures:
        """The test of the folder and random periods, with sanitizers, in float and double."""
        figures: Figures = {}
        for real in ("float", "double"):
            self._run(self._build("cc", SANITIZED, "test.c", real))
            found = _read(self._run(self._build("cc", SANITIZED, "fuzz.c", real), str(periods)))
            for name in ("solved", "broken", "iterations_worst"):
                figures[f"{real}_{name}"] = found[name]
        return figures | {"periods": periods}

    def objects(self) -> Figures:
        """Number of calls that the law must not make; compiled with all warnings as errors."""
        compilers = [name for name in ("gcc", "clang") if shutil.which(name)]
        for compiler in compilers:
            for file in self._law:
                self._run(compiler, "-std=c99", *STRICT.split(), "-DMDK_FLOAT", file)
        objects = [f"{Path(file).stem}.o" for file in self._law]
        called = [line.split()[-1] for line in self._run("nm", "-u", *objects).splitlines() if line]
        return {
            "forbidden_calls": sum(bool(FORBIDDEN.fullmatch(name)) for name in called),
            "compilers_without_warnings": len(compilers),
        }

    def _build(self, compiler: str, options: str, main: str, real: str = "float") -> str:
        """A program of one file and the law."""
        program = f"./{Path(main).stem}"
        flags = ["-std=gnu99", "-ffp-contract=off", *options.split()]
        flags += [f"-DMDK_FLOAT={int(real == 'float')}"]
        self._run(compiler, *flags, main, *self._law, "-lm", "-o", program)
        return program

    def _run(self, *command: str) -> str:
        """What a program printed.

        Raises:
            RuntimeError: its exit code is not 0.
        """
        done = subprocess.run(
            command, cwd=self._folder, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            text = (done.stdout + done.stderr)[-2000:]
            raise RuntimeError(f"{' '.join(command)}: exit code {done.returncode}\n{text}")
        return done.stdout


def _read(text: str) -> dict[str, float]:
    """The numbers of a program that prints one a line, each behind its name."""
    rows = (line.split() for line in text.splitlines())
    return {name: float(number) for name, number in rows if "hash" not in name}
