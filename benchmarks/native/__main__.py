"""`python -m benchmarks.native`: the control law in C beside the one in Python, and on targets."""

import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cyclopts
from rich.console import Console

from benchmarks.figures.closed_loop import ROWS, scenario_of
from benchmarks.native.parity import Plans, compare
from benchmarks.native.situations import random_situations
from benchmarks.native.targets import Export, Figures
from offline.commands.options import JsonFile
from offline.targets.recorded_drives import Situation, record_drive
from rt_controller.config import ControllerConfig
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.model.bundle import Bundle
from rt_controller.terminal.command_line import run_command

GOALS = Path(__file__).with_name("goals.toml")
GROWTH = 1.1
"""of a number of instructions, which is the measured one and no goal"""
SHORT = ("lane change over 38 m, 80 km/h", "slalom", "stop and go")
PLANS, FULL_PLANS = 2_000, 20_000
"""of drives; half as many of random situations"""
FUZZED, FULL_FUZZED = 2_000, 200_000
SEED = 1
EXIT_MISSED = 1

app = cyclopts.App(name="python -m benchmarks.native", version_flags=[])


@app.default
def main(
    *,
    model: str = "mdk-net",
    json: JsonFile = None,
    full: bool = False,
) -> int:
    """Compare the law in C with the law in Python, and run it on a Cortex-M7 and an ARM64 in QEMU.

    Exit code 1: a figure is beyond its goal in benchmarks/native/goals.toml. Figures of a tool that
    is not installed are null in the JSON file.

    Args:
        model: name of a shipped model, or folder of a bundle.
        full: ten times as many plans, and a hundred times as many periods of the fuzzing.
    """
    require_writable(json)
    console, bundle = Console(soft_wrap=True, highlight=False), Bundle.load(model)
    drives = compare(_drives(bundle, full), bundle)
    plans = (FULL_PLANS if full else PLANS) // 2
    situations = compare([random_situations(bundle, plans, SEED)], bundle)
    figures: dict[str, Any] = {
        "model": bundle.name,
        "drives": _parity(drives),
        "random": _parity(situations),
        "times": {name: drives[name].medians_us() for name in ("python", "double", "float")},
        **_on_targets(bundle, FULL_FUZZED if full else FUZZED, console),
    }
    goals = tomllib.loads(GOALS.read_text())
    largest = dict(_leaves(goals["every"])) | dict(_leaves(goals.get(bundle.name, {})))
    missed = False
    for name, value in _leaves(figures):
        goal = largest.get(name)
        limit = None if goal is None else goal * (GROWTH if "instructions" in name else 1.0)
        is_beyond = None not in (limit, value) and value > limit
        text = f"{value:.3g}" if isinstance(value, float) else f"{value}"
        goal_text = "" if goal is None else f"  goal {goal:g}{' MISSED' * is_beyond}"
        console.print(f"{name:<44}{text:>12}{goal_text}")
        missed |= is_beyond
    write_figures(json, figures)
    return EXIT_MISSED if missed else 0


def _drives(bundle: Bundle, full: bool) -> Iterator[list[Situation]]:
    """Recorded drives until there are enough situations."""
    missing = FULL_PLANS if full else PLANS
    for row in ROWS:
        if missing > 0 and (full or row.name in SHORT):
            plant = row.conditions.get("plant", "own")
            found = record_drive(bundle, ControllerConfig(), scenario_of(row), plant=plant)
            yield found
            missing -= len(found)


def _parity(found: Mapping[str, Plans]) -> dict[str, Any]:
    pairs = {
        f"{real}_to_{reference}": found[real].parity(found[reference])
        for real in ("double", "float")
        for reference in ("exact", "python")
    }
    return pairs | {real: found[real].counts() for real in ("double", "float")}


def _on_targets(bundle: Bundle, fuzzed: int, console: Console) -> dict[str, Figures | None]:
    """Figures of what the installed tools can run."""
    found: dict[str, Figures | None] = {}
    with TemporaryDirectory() as work:
        export = Export(bundle, Path(work))
        parts: Mapping[str, tuple[Callable[[], Figures], tuple[str, ...]]] = {
            "cortex_m7": (export.cortex_m7, ("arm-none-eabi-gcc", "qemu-system-arm")),
            "aarch64": (
                lambda: export.aarch64(FUZZED),
                ("aarch64-linux-gnu-gcc", "qemu-aarch64", "cc"),
            ),
            "sanitized": (lambda: export.sanitized(fuzzed), ("cc",)),
            "objects": (export.objects, ("gcc", "nm")),
        }
        for name, (measure, tools) in parts.items():
            missing = [tool for tool in tools if shutil.which(tool) is None]
            if missing:
                console.print(f"{name}: not measured, {', '.join(missing)} is not installed")
            found[name] = None if missing else measure()
    return found


def _leaves(tree: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Values of nested tables, with their names joined by points."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{path}{name}.")
        else:
            yield path + name, value


if __name__ == "__main__":
    run_command(app)
