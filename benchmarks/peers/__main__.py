"""`python -m benchmarks.peers`: the controller's QPs through every solver that is installed."""

import sys
from pathlib import Path
from typing import Annotated

import cyclopts
from rich.console import Console

from benchmarks.peers.entrants.roster import entrants
from benchmarks.peers.figures import duel_table, to_json, to_table
from benchmarks.peers.race import Mode
from benchmarks.peers.recording import record
from benchmarks.peers.standings import compare
from benchmarks.peers.tiers import TIERS
from rt_controller.contract.figures import write_figures

HARD = Path(__file__).parent / "hard_lane_change.toml"
SCENARIOS = {"mild": "double_lane_change", "hard": str(HARD)}

SHOWN = ("slew", Mode.PREPARED)
"""what the picture is of: the controller as it ships"""

app = cyclopts.App(name="python -m benchmarks.peers", version_flags=[])


@app.default
def main(
    *,
    models: tuple[str, ...] = ("mdk-net", "mdk-net-paper"),
    tiers: tuple[str, ...] = tuple(TIERS),
    scenarios: tuple[str, ...] = tuple(SCENARIOS),
    modes: tuple[Mode, ...] = tuple(Mode),
    only: tuple[str, ...] = (),
    rounds: int = 5,
    nonlinear: bool = True,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
    plot: Path | None = None,
) -> int:
    """Record closed-loop drives, then let every solver answer the same quadratic programs.

    Parameters
    ----------
    models
        Shipped bundles to drive with; mdk-net has a new Hessian every tick.
    tiers
        box: the paper's QP; slew: with the controller's rows; corridor: with soft bounds on e_y.
    scenarios
        mild: the shipped double lane change; hard: one near the limit of grip.
    modes
        What is known before the tick.
    only
        Names of solvers, if not all shall take part; the controller's own always do.
    rounds
        How often everybody runs; ratios are taken within a round.
    nonlinear
        Whether controllers with a nonlinear model drive too; compiling them takes some minutes.
    json
        The same figures for a program.
    plot
        A picture of the first model's (SVG or PNG): the controller's own tier, prepared.
    """
    console = Console()
    everybody, missing = entrants(only)
    if missing:
        console.print(f"not installed: {', '.join(missing)}", highlight=False)
    found = []
    for model in models:
        for scenario in scenarios:
            for tier in tiers:
                with console.status(f"{model}, {scenario}, {tier}: driving"):
                    recording = record(model, SCENARIOS[scenario], TIERS[tier])
                for mode in modes:
                    title = f"{model}, {scenario}, {tier}, {mode.value}"
                    with console.status(title):
                        standings = compare(recording, everybody, mode, rounds)
                    console.print(to_table(title, standings))
                    found.append((model, scenario, tier, mode, standings))
    duels = []
    if nonlinear:
        from benchmarks.peers.nonlinear.duel import Duel

        for model in models:
            with console.status(f"{model}: compiling the nonlinear controllers"):
                duel = Duel(model, only)
            for scenario in scenarios:
                with console.status(f"{model}, {scenario}: driving with each of them"):
                    summaries = duel.drive(SCENARIOS[scenario], rounds)
                console.print(duel_table(f"{model}, {scenario}, closed loop", summaries))
                duels.append((model, scenario, summaries))
    write_figures(json, to_json(found, duels, everybody, missing, rounds))
    if plot is not None:
        from benchmarks.peers.plot import draw

        shown = [one for one in found if (one[0], one[2], one[3]) == (models[0], *SHOWN)]
        draw(shown, [one for one in duels if one[0] == models[0]][:1], plot)
        console.print(str(plot))
    return 0


if __name__ == "__main__":
    sys.exit(app())
