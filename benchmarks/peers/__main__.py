"""`python -m benchmarks.peers`: the controller's QPs through every solver that is installed."""

import platform
from itertools import product
from pathlib import Path
from typing import Annotated, Literal, get_args

import cyclopts
from rich.console import Console

from benchmarks.peers.recording import TIERS, Tier, record
from benchmarks.peers.solver_comparison import HEADS, Mode, compare
from benchmarks.peers.solvers.registry import find_solvers, require_names
from benchmarks.tables import to_plain, to_tables
from rt_controller.config import ShippedModel
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.report.drive_figure import require_figure_file
from rt_controller.report.table import print_table
from rt_controller.terminal.command_line import run_command

HARD = Path(__file__).parent / "hard_lane_change.toml"
Scenario = Literal["mild", "hard"]
SCENARIOS: dict[Scenario, str] = {"mild": "double_lane_change", "hard": str(HARD)}
PLOTTED = {"tier": "slew", "mode": Mode.PREPARED.value}
"""the shipped controller"""

app = cyclopts.App(name="python -m benchmarks.peers", version_flags=[])


@app.default
def main(
    *,
    models: tuple[ShippedModel, ...] = ("mdk-net", "mdk-net-paper"),
    tiers: tuple[Tier, ...] = get_args(Tier),
    scenarios: tuple[Scenario, ...] = get_args(Scenario),
    modes: tuple[Mode, ...] = tuple(Mode),
    only: tuple[str, ...] = (),
    rounds: int = 5,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
    plot: Path | None = None,
) -> int:
    """Record closed-loop drives, then solve the same quadratic programs with every solver.

    Parameters
    ----------
    models
        Shipped models to drive with; mdk-net has a new Hessian every period.
    tiers
        slew: with slew rates; corridor: also with soft bounds on e_y.
    scenarios
        mild: the shipped double lane change; hard: one near the limit of grip.
    modes
        What a solver is given before the clock starts.
    only
        Names of the solvers to compare; the controller's own are always included.
    rounds
        Repetitions of all solvers; ratios are taken within a round.
    json
        File for all figures.
    plot
        File (SVG or PNG) for a plot of the first model: slew, prepared.
    """
    require_writable(json)
    if plot is not None:
        require_writable(plot, "--plot")
        require_figure_file(plot)
    require_names(only)
    console = Console()
    entries, missing = find_solvers(only)
    if missing:
        console.print(f"not installed: {', '.join(missing)}", highlight=False)
    recordings = []
    for model, scenario, tier in product(models, scenarios, tiers):
        with console.status(f"{model}, {scenario}, {tier}: driving"):
            recording = record(model, SCENARIOS[scenario], TIERS[tier])
        for mode in modes:
            names = {"model": model, "scenario": scenario, "tier": tier, "mode": mode.value}
            title = ", ".join(names.values())
            with console.status(title):
                recordings.append((names, compare(recording, entries, mode, rounds)))
            for table in to_tables(title, recordings[-1][1], HEADS):
                print_table(table, console)
    figures = {
        "machine": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "rounds": rounds,
        "versions": {entry.name: entry.version for entry in entries},
        "not_installed": missing,
        "recordings": [names | {"solvers": to_plain(one)} for names, one in recordings],
    }
    write_figures(json, figures)
    if plot is not None:
        from benchmarks.peers.plot import plot as write_plot

        shown = {"model": models[0], **PLOTTED}
        panels = [
            ("QP of {model}\n{scenario} lane change, {tier}, {mode}".format(**names), one)
            for names, one in recordings
            if shown.items() <= names.items()
        ]
        write_plot(panels, plot)
        console.print(str(plot))
    return 0


if __name__ == "__main__":
    run_command(app)
