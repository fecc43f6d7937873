"""`python -m benchmarks.cadence`: frames in to frames out, every 25 ms, for long."""

import sys
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from rich.console import Console
from rich.table import Table

from benchmarks.cadence.drive import Transport, drive
from benchmarks.cadence.host import stolen_s
from benchmarks.cadence.pool import Pool
from rt_controller.contract.figures import write_figures
from rt_controller.session import shipped_model

VARIANTS = {
    "default": (),
    "fast": ("--mpc.solver", "daqp"),
    "unprepared": ("--realtime.prepare-ms", "0"),
    "paper": ("--model", "mdk-net-paper"),
    "lti": ("--model", "lti"),
}
FIELDS = (
    "step_us",
    "hear_us",
    "plan_us",
    "qp_us",
    "answer_us",
    "cpu_us",
    "listen_us",
    "whole_us",
    "wake_us",
    "prepare_us",
)

FEWEST_TICKS = 100
"""that are worth another drive"""
MOST_DRIVES = 50
"""for one round of a variant"""

app = cyclopts.App(name="python -m benchmarks.cadence", version_flags=[])


@app.default
def main(
    *,
    variants: tuple[str, ...] = ("default", "fast"),
    ticks: int = 40_000,
    rounds: int = 1,
    transport: Transport = Transport.LOCAL,
    car_cpu: int = 0,
    controller_cpu: int = 1,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> int:
    """Drive in real time and print what a step took, stage by stage.

    Parameters
    ----------
    variants
        default; fast: DAQP; unprepared: nothing done before the tick; paper, lti: other models.
    ticks
        Of 25 ms, of each variant in a round: 40,000 take 17 minutes. Where the machine stands still
        for so long that the car is stopped, another drive makes up for what is missing.
    rounds
        Of all variants, in turn; the figures are those of all ticks.
    transport
        local: shared memory; remote: python-can-remote and its server.
    car_cpu
        The core of the car, and of the server.
    controller_cpu
        The core of the controller.
    json
        The same figures for a program.
    """
    console = Console()
    pools = {variant: Pool() for variant in variants}
    stolen = dict.fromkeys(variants, 0.0)
    for round_ in range(rounds):
        for variant, pool in pools.items():
            console.print(f"{variant}: {ticks} ticks, {ticks * 0.025:.0f} s")
            before_s = stolen_s()
            for _ in range(MOST_DRIVES):
                missing = (round_ + 1) * ticks - pool.n_ticks
                pool.add(*drive(missing, _options(variant), transport, car_cpu, controller_cpu))
                if (round_ + 1) * ticks - pool.n_ticks < FEWEST_TICKS:
                    break
            stolen[variant] += stolen_s() - before_s
    found = [
        {"variant": variant, "stolen_s_all_cores": stolen[variant], **_with_sums(pool.figures())}
        for variant, pool in pools.items()
    ]
    for figures in found:
        console.print(_table(figures))
    write_figures(
        json, {"ticks": ticks, "rounds": rounds, "transport": transport.value, "variants": found}
    )
    return 0


def _with_sums(figures: dict[str, Any]) -> dict[str, Any]:
    mean_us = {field: figures[field]["mean"] for field in FIELDS}
    return {
        "computed_s_in_400_steps": 400e-6 * mean_us["whole_us"],
        "computed_s_in_400_ticks": 400e-6 * (mean_us["whole_us"] + mean_us["prepare_us"]),
        **figures,
    }


def _options(variant: str) -> list[str]:
    return [
        str(shipped_model(option)) if before == "--model" else option
        for before, option in zip(("", *VARIANTS[variant]), VARIANTS[variant], strict=False)
    ]


def _table(found: dict[str, Any]) -> Table:
    table = Table(title=f"{found['variant']}, {found['model']}", title_justify="left")
    for head in ("us", "p50", "p99", "p99.9", "max"):
        table.add_column(head, justify="left" if head == "us" else "right")
    for field in FIELDS:
        times = found[field]
        figures = (times[key] for key in ("p50", "p99", "p999", "max"))
        table.add_row(field.removesuffix("_us"), *(f"{figure:.0f}" for figure in figures))
    worst = found["worst_tick"]
    table.add_section()
    table.add_row("missed", str(found["deadline_misses"]), f"of {found['ticks']}")
    table.add_row("skipped", str(found["skipped_ticks"]), f"{found['safe_stops']} safe stops")
    table.add_row("worst", f"{worst['late_us']:.0f}", worst["cause"])
    table.add_row("400 steps, ms", f"{1e3 * found['computed_s_in_400_steps']:.0f}", "whole")
    table.add_row("400 ticks, ms", f"{1e3 * found['computed_s_in_400_ticks']:.0f}", "and prepare")
    table.add_row("steal, s", f"{found['stolen_s_all_cores']:.2f}")
    return table


if __name__ == "__main__":
    sys.exit(app())
