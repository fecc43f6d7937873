"""`python -m benchmarks.cadence`: the step from frames in to frames out, once a period.

Vehicle and controller drive in real time, each in a process of its own.
"""

import json as json_module
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cyclopts
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from offline.commands.options import JsonFile
from rt_controller.contract.errors import BusError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.artifact import shipped_model
from rt_controller.realtime.timing import TickTimes, percentiles_of
from rt_controller.report.table import Column, Table, print_table
from rt_controller.terminal.command_line import run_command

Variant = Literal["default", "unprepared", "paper", "lti"]
VARIANTS: dict[Variant, tuple[str, ...]] = {
    "default": (),
    "unprepared": ("--realtime.prepare-ms", "0"),
    "paper": ("--model", str(shipped_model("mdk-net-paper"))),
    "lti": ("--model", str(shipped_model("lti"))),
}
QUANTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}
"""their keys among the figures, and their heads"""
MIN_TICKS, MAX_DRIVES = 100, 50
"""fewer missing ticks than this do not need another drive; drives of a variant in one round"""
USER_HZ = 100.0
"""unit of /proc/stat"""
SPEED_KMH, SPACING_M = 80.0, 400.0
TIMEOUT_S = 60.0
STALL_CAUSES = (
    StopCause.STATE_LOST.name,
    StopCause.REFERENCE_LOST.name,
    StopCause.MISSION_LOST.name,
    StopCause.VEHICLE_BRAKING.name,
)
"""why a drive stops if the host does not run its processes for some time"""


class CadenceRun(NamedTuple):
    """One drive."""

    summary: dict[str, Any]
    """as `rt-controller --json` writes it"""
    ticks: NDArray[np.void]
    """(ticks,), structured: the fields of `TickTimes` and the number of the tick"""


app = cyclopts.App(name="python -m benchmarks.cadence", version_flags=[])


@app.default
def main(
    *,
    variants: tuple[Variant, ...] = ("default",),
    ticks: int = 40_000,
    rounds: int = 1,
    car_cpu: int = 0,
    controller_cpu: int = 1,
    json: JsonFile = None,
) -> int:
    """Drive in real time and print the time of each stage of the step.

    Args:
        variants: default; unprepared: nothing done before the tick; paper, lti: other models.
        ticks: of each variant in a round: 40,000 take 17 minutes. If the host stalls and the car is
            stopped, another drive supplies the missing ticks.
        rounds: repetitions of all variants in turn; figures are of all ticks.
        car_cpu: core of the vehicle.
        controller_cpu: core of the controller.
    """
    require_writable(json)
    console = Console()
    drives: dict[Variant, list[CadenceRun]] = {variant: [] for variant in variants}
    stolen_s = dict.fromkeys(variants, 0.0)
    for round_ in range(rounds):
        for variant, driven in drives.items():
            console.print(f"{variant}: {ticks} ticks, {ticks * PERIOD_S:.0f} s")
            before_s = _stolen_s()
            for _ in range(MAX_DRIVES):
                missing = (round_ + 1) * ticks - sum(len(drive.ticks) for drive in driven)
                if missing < MIN_TICKS and driven:
                    break
                cpus = car_cpu, controller_cpu
                driven.append(drive_in_real_time(missing, VARIANTS[variant], *cpus))
            stolen_s[variant] += _stolen_s() - before_s
    figures = [
        {"variant": variant, "stolen_s_all_cores": stolen_s[variant], **aggregate(driven)}
        for variant, driven in drives.items()
    ]
    for one in figures:
        print_table(_table(one), console)
    write_figures(json, {"ticks": ticks, "rounds": rounds, "variants": figures})
    return 0


def _stolen_s() -> float:
    """Time since its start that the host ran other guests on this machine's cores."""
    fields = Path("/proc/stat").read_text().splitlines()[0].split()
    return float(fields[8]) / USER_HZ


def aggregate(drives: Sequence[CadenceRun]) -> dict[str, Any]:
    """Percentiles of each time over all ticks, counts, and the worst tick of any drive.

    A stall of the host ends a drive, not the count.
    """
    summaries = [drive.summary for drive in drives]
    ticks = np.concatenate([drive.ticks for drive in drives])
    rows = np.stack([ticks[name] for name in TickTimes._fields], axis=1)
    times = {name: percentiles_of(rows, name)._asdict() for name in TickTimes._fields}
    step_us, preparation_us = (times[name]["mean"] for name in ("total_us", "preparation_us"))
    return {
        "computed_s_in_400_steps": 400e-6 * step_us,
        "computed_s_in_400_ticks": 400e-6 * (step_us + preparation_us),
        **{key: summaries[0][key] for key in ("model", "scheduler", "memory_locked")},
        "ticks": len(ticks),
        "drives": len(drives),
        "safe_stops": sum(summary["ending"] == "SAFE_STOPPED" for summary in summaries),
        "deadline_misses": sum(summary["deadline_misses"] for summary in summaries),
        "skipped_ticks": sum(summary["skipped_ticks"] for summary in summaries),
        "worst_tick": max(
            (summary["worst_tick"] for summary in summaries),
            key=lambda worst: float(worst["late_us"]),
        ),
        **times,
    }


def _table(found: dict[str, Any]) -> Table:
    times = tuple(
        (name.removesuffix("_us"), *(f"{found[name][key]:.0f}" for key in QUANTILES))
        for name in TickTimes._fields
        if name.endswith("_us")
    )
    worst = found["worst_tick"]
    notes = (
        f"{found['deadline_misses']} of {found['ticks']} ticks missed the deadline, "
        f"{found['skipped_ticks']} were skipped; {found['safe_stops']} safe stops",
        f"worst tick: {worst['late_us']:.0f} us late, {worst['cause']}",
        f"400 steps: {1e3 * found['computed_s_in_400_steps']:.0f} ms, with preparation "
        f"{1e3 * found['computed_s_in_400_ticks']:.0f} ms",
        f"stolen by the host: {found['stolen_s_all_cores']:.2f} s",
    )
    columns = (Column("us", is_text=True), *map(Column, QUANTILES.values()))
    return Table(f"{found['variant']}, {found['model']}", columns, times, notes)


def write_slalom(file: Path, ticks: int) -> None:
    """Write a scenario of so many ticks: regular lane changes on a constant curve."""
    duration_s = ticks * PERIOD_S
    count = int(duration_s * SPEED_KMH / 3.6 / SPACING_M) + 1
    moves = ", ".join(
        f"{{ start_m = {25.0 + k * SPACING_M}, length_m = 60.0, to_m = {3.5 * (1 - k % 2)} }}"
        for k in range(count)
    )
    lines = (
        f'format = 2\nname = "slalom"\nduration_s = {duration_s}',
        f"[reference]\nspeed_kmh = {SPEED_KMH}\ney_m = {{ kind = 'moves', moves = [{moves}] }}",
        "[road]\ncurvature_per_m = 0.001\nfriction = 0.85\n",
    )
    file.write_text("\n".join(lines))


def start(*command: str, log: Path, running: ExitStack) -> subprocess.Popen[bytes]:
    """A program in a process of its own, which ends with `running`."""
    environment = {**os.environ, "COLUMNS": "200"}
    with log.open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
    running.callback(process.wait)
    running.callback(process.kill)
    return process


def drive_in_real_time(
    ticks: int, options: Sequence[str], car_cpu: int, controller_cpu: int
) -> CadenceRun:
    """A slalom of so many ticks.

    The vehicle runs on one core, the controller on the other. If the host stalls for long, the
    drive ends early in a safe stop.

    Raises:
        BusError: the drive ended early for another reason.
    """
    with tempfile.TemporaryDirectory() as name, ExitStack() as running:
        folder = Path(name)
        scenario = folder / "slalom.toml"
        write_slalom(scenario, ticks)
        bus = ("--bus", "local", "--channel", f"cadence-{folder.name}", "--quiet")
        car_log, controller_log = folder / "car.log", folder / "controller.log"
        summary_file, ticks_file = folder / "controller.json", folder / "ticks.csv"
        python = (sys.executable, "-m")
        car = ("taskset", "-c", str(car_cpu), *python, "sim_bridge", *bus)
        start(*car, "--scenario", str(scenario), log=car_log, running=running)
        files = ("--json", str(summary_file), "--ticks", str(ticks_file))
        command = (*python, "rt_controller", *bus, "--realtime.cpu", str(controller_cpu))
        controller = start(*command, *files, *options, log=controller_log, running=running)
        controller.wait(ticks * PERIOD_S + TIMEOUT_S)
        if not summary_file.exists():
            raise BusError(controller_log.read_text()[-1000:])
        summary: dict[str, Any] = json_module.loads(summary_file.read_text())
        if summary["ending"] != "MISSION_OVER" and summary["stop_cause"] not in STALL_CAUSES:
            raise BusError(
                f"expected a complete drive, found {summary['ending']} after "
                f"{summary['ticks']} ticks.\n{car_log.read_text()[-1000:]}"
            )
        times = np.genfromtxt(ticks_file, delimiter=",", names=True)
        return CadenceRun(summary, np.atleast_1d(times))


if __name__ == "__main__":
    run_command(app)
