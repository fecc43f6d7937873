"""`python -m benchmarks.peers`: the controller's QPs through every solver that is installed."""

import platform
from collections.abc import Sequence
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

import cyclopts
from rich.console import Console

from benchmarks.peers.comparison import compare, tables_of
from benchmarks.peers.recording import TIERS, Tier, record
from benchmarks.peers.solvers import COLD, DEFAULT, find_solvers
from offline.commands.options import JsonFile
from rt_controller.config import ShippedModel
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.report.drive_figure import require_figure_file
from rt_controller.report.table import print_table
from rt_controller.terminal.command_line import run_command

HARD = Path(__file__).parents[1] / "scenarios" / "hard_lane_change.toml"
Scenario = Literal["mild", "hard"]
SCENARIOS: dict[Scenario, str] = {"mild": "double_lane_change", "hard": str(HARD)}

app = cyclopts.App(name="python -m benchmarks.peers", version_flags=[])


@app.default
def main(
    *,
    models: tuple[ShippedModel, ...] = ("mdk-net", "mdk-net-paper"),
    tiers: tuple[Tier, ...] = get_args(Tier),
    scenarios: tuple[Scenario, ...] = get_args(Scenario),
    only: tuple[str, ...] = (),
    rounds: int = 5,
    json: JsonFile = None,
    plot: Path | None = None,
) -> int:
    """Record closed-loop drives, then solve the same quadratic programs with every solver.

    Args:
        models: shipped models to drive with; mdk-net has a new Hessian every period.
        tiers: slew: with slew rates; corridor: also with soft bounds on e_y.
        scenarios: mild: the shipped double lane change; hard: one near the limit of grip.
        only: names of the solvers to compare; the controller's own are always included.
        rounds: repetitions of all solvers; ratios are taken within a round.
        plot: file (SVG or PNG) for a plot of the first model with slew.
    """
    require_writable(json)
    if plot is not None:
        require_writable(plot, "--plot")
        require_figure_file(plot, moves=False)
    console = Console()
    entries, missing = find_solvers(only)
    if missing:
        console.print(f"not installed: {', '.join(missing)}", highlight=False)
    recordings = []
    for model, scenario, tier in product(models, scenarios, tiers):
        with console.status(f"{model}, {scenario}, {tier}: driving"):
            recording = record(model, SCENARIOS[scenario], TIERS[tier])
        names = {"model": model, "scenario": scenario, "tier": tier}
        title = ", ".join(names.values())
        with console.status(title):
            recordings.append((names, compare(recording, entries, rounds)))
        for table in tables_of(title, recordings[-1][1]):
            print_table(table, console)
    figures = {
        "machine": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "rounds": rounds,
        "versions": {entry.name: version(entry.package) for entry in entries},
        "not_installed": missing,
        "recordings": [names | {"solvers": one} for names, one in recordings],
    }
    write_figures(json, figures)
    if plot is not None:
        shown = {"model": models[0], "tier": "slew"}  # as in the shipped controller
        panels = [
            ("QP of {model}\n{scenario} lane change, {tier}".format(**names), one)
            for names, one in recordings
            if shown.items() <= names.items()
        ]
        write_plot(panels, plot)
        console.print(str(plot))
    return 0


def write_plot(panels: Sequence[tuple[str, dict[str, dict[str, Any]]]], file: Path) -> None:
    """Write the times, median to p99: a panel for each title and figures, the fastest at the top.

    A solver that is not accurate, or leaves problems unsolved, has a hollow marker.
    """
    from matplotlib.figure import Figure

    rows = max(len(solvers) for _, solvers in panels)
    figure = Figure(figsize=(3.4 * len(panels), 0.23 * rows + 1.2), layout="constrained")
    all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, solvers) in zip(all_axes, panels, strict=True):
        for row, (name, one) in enumerate(reversed(solvers.items())):
            is_hollow = not one["is_accurate"] or one["unsolved"] > 0
            color = "#2f6fb3" if name in (DEFAULT, COLD) else "#8a97a5"
            axes.plot([one["p50_us"], one["p99_us"]], [row, row], color=color, linewidth=2.0)
            fill: Any = "none" if is_hollow else "full"
            axes.plot(one["p50_us"], row, "o", color=color, fillstyle=fill)
        axes.set_xscale("log")
        axes.set_title(title, fontsize=8, loc="left")
        axes.grid(axis="x", linewidth=0.4)
        axes.set_xlabel("us, median to p99", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_yticks(range(len(solvers)), list(reversed(solvers)))
    figure.savefig(file)


if __name__ == "__main__":
    run_command(app)
