"""The standings as a picture: how long each solver takes, median to p99."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.peers.entrants.roster import DEFAULT
from benchmarks.peers.figures import Found

OURS, OTHERS = "#2f6fb3", "#8a97a5"


def draw(found: Sequence[Found], file: Path) -> None:
    """One panel a recording, solvers in the order of the first one's medians."""
    figure = Figure(figsize=(3.2 * len(found) + 1.2, 3.6), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(found), sharey=True, sharex=True))
    order = [one.name for one in sorted(found[0][-1], key=lambda one: -one.p50_us)]
    for axes, (model, scenario, tier, mode, standings) in zip(panels, found, strict=True):
        for one in standings:
            row = order.index(one.name)
            is_exact = one.is_exact_enough and one.unsolved == 0
            color = OURS if one.name in (DEFAULT, "DAQP") else OTHERS
            axes.plot([one.p50_us, one.p99_us], [row, row], color=color, linewidth=2.0)
            axes.plot(one.p50_us, row, "o", color=color, fillstyle="full" if is_exact else "none")
        axes.set_xscale("log")
        axes.set_title(f"{model}\n{scenario}, {tier}, {mode.value}", fontsize=8)
        axes.grid(axis="x", linewidth=0.4)
        axes.set_xlabel("us a problem, median to p99", fontsize=8)
    panels[0].set_yticks(range(len(order)), order, fontsize=8)
    figure.savefig(file)
