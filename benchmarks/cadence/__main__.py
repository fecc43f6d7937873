"""`python -m benchmarks.cadence`: the step from frames in to frames out, once a period."""

from pathlib import Path
from typing import Annotated, Any, Literal

import cyclopts
from rich.console import Console

from benchmarks.cadence.drive import CadenceRun, Transport, aggregate, drive_in_real_time
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.artifact import shipped_model
from rt_controller.realtime.timing import TickTimes
from rt_controller.report.table import Column, Fact, Table, facts_table, print_table
from rt_controller.terminal.command_line import run_command

Variant = Literal["default", "unprepared", "paper", "lti"]
VARIANTS: dict[Variant, tuple[str, ...]] = {
    "default": (),
    "unprepared": ("--realtime.prepare-ms", "0"),
    "paper": ("--model", str(shipped_model("mdk-net-paper"))),
    "lti": ("--model", str(shipped_model("lti"))),
}
TIMES = [field for field in TickTimes._fields if field.endswith("_us")]
QUANTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}
"""their keys among the figures, and their heads"""
MIN_TICKS = 100
"""fewer missing ticks than this do not need another drive"""
MAX_DRIVES = 50
"""of a variant in one round"""
USER_HZ = 100.0
"""unit of /proc/stat"""

app = cyclopts.App(name="python -m benchmarks.cadence", version_flags=[])


@app.default
def main(
    *,
    variants: tuple[Variant, ...] = ("default",),
    ticks: int = 40_000,
    rounds: int = 1,
    transport: Transport = Transport.LOCAL,
    car_cpu: int = 0,
    controller_cpu: int = 1,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """Drive in real time and print the time of each stage of the step.

    Parameters
    ----------
    variants
        default; unprepared: nothing done before the tick; paper, lti: other models.
    ticks
        Ticks of each variant in a round: 40,000 take 17 minutes. If the host stalls and the car is
        stopped, another drive supplies the missing ticks.
    rounds
        Repetitions of all variants in turn; figures are of all ticks.
    transport
        local: shared memory; remote: python-can-remote and its server.
    car_cpu
        Core of the vehicle, and of the server.
    controller_cpu
        Core of the controller.
    json
        File for all figures.
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
                options = VARIANTS[variant]
                driven.append(
                    drive_in_real_time(missing, options, transport, car_cpu, controller_cpu)
                )
            stolen_s[variant] += _stolen_s() - before_s
    figures = [
        {"variant": variant, "stolen_s_all_cores": stolen_s[variant], **_with_sums(driven)}
        for variant, driven in drives.items()
    ]
    for one in figures:
        for table in _tables(one):
            print_table(table, console)
    write_figures(
        json, {"ticks": ticks, "rounds": rounds, "transport": transport.value, "variants": figures}
    )
    return 0


def _stolen_s() -> float:
    """Time since its start that the host ran other guests on this machine's cores."""
    fields = Path("/proc/stat").read_text().splitlines()[0].split()
    return float(fields[8]) / USER_HZ


def _with_sums(drives: list[CadenceRun]) -> dict[str, Any]:
    figures = aggregate(drives)
    step_us, preparation_us = figures["total_us"]["mean"], figures["preparation_us"]["mean"]
    return {
        "computed_s_in_400_steps": 400e-6 * step_us,
        "computed_s_in_400_ticks": 400e-6 * (step_us + preparation_us),
        **figures,
    }


def _tables(found: dict[str, Any]) -> tuple[Table, Table]:
    times = tuple(
        (name.removesuffix("_us"), *(f"{found[name][key]:.0f}" for key in QUANTILES))
        for name in TIMES
    )
    columns = (Column("us", is_text=True), *map(Column, QUANTILES.values()))
    worst = found["worst_tick"]
    facts = (
        Fact("missed deadlines", f"{found['deadline_misses']} of {found['ticks']}"),
        Fact("skipped ticks", str(found["skipped_ticks"])),
        Fact("safe stops", str(found["safe_stops"])),
        Fact("worst tick", f"{worst['late_us']:.0f} us late, {worst['cause']}"),
        Fact("400 steps", f"{1e3 * found['computed_s_in_400_steps']:.0f} ms"),
        Fact("400 steps with preparation", f"{1e3 * found['computed_s_in_400_ticks']:.0f} ms"),
        Fact("stolen by the host", f"{found['stolen_s_all_cores']:.2f} s"),
    )
    return Table(f"{found['variant']}, {found['model']}", columns, times), facts_table(facts)


if __name__ == "__main__":
    run_command(app)
