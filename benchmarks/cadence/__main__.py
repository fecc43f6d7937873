"""`python -m benchmarks.cadence`: frames in to frames out, every 25 ms, for long."""

import sys
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from rich.console import Console
from rich.table import Table

from benchmarks.cadence.drive import Transport, drive
from benchmarks.cadence.host import stolen_s
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
        Of 25 ms, for each drive: 40,000 take 17 minutes.
    rounds
        Drives of each variant, in turn.
    transport
        local: datagrams; remote: python-can-remote and its server.
    car_cpu
        The core of the car, and of the server.
    controller_cpu
        The core of the controller.
    json
        The same figures for a program.
    """
    console = Console()
    drives = []
    for _ in range(rounds):
        for variant in variants:
            console.print(f"{variant}: {ticks} ticks, {ticks * 0.025:.0f} s")
            before_s = stolen_s()
            summary = drive(ticks, _options(variant), transport, car_cpu, controller_cpu)
            drives.append(
                {
                    "variant": variant,
                    "stolen_s_all_cores": stolen_s() - before_s,
                    "computed_s_in_400_steps": _in_400_steps(summary),
                    **summary,
                }
            )
            console.print(_table(drives[-1]))
    write_figures(
        json, {"ticks": ticks, "rounds": rounds, "transport": transport.value, "drives": drives}
    )
    return 0


def _in_400_steps(summary: dict[str, Any]) -> float:
    """Seconds, with what is done before the ticks."""
    mean_us: float = summary["whole_us"]["mean"] + summary["prepare_us"]["mean"]
    return 400 * mean_us / 1e6


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
    table.add_row("worst", f"{worst['late_us']:.0f}", worst["cause"])
    table.add_row("400 steps, ms", f"{1e3 * found['computed_s_in_400_steps']:.0f}", "all told")
    table.add_row("steal, s", f"{found['stolen_s_all_cores']:.2f}")
    return table


if __name__ == "__main__":
    sys.exit(app())
