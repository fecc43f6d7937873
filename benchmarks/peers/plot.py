"""The standings as a picture: how long each one takes, median to p99."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from benchmarks.peers.entrants.roster import COLD, DEFAULT, FAST
from benchmarks.peers.figures import Driven, Found

OURS, OTHERS = "#2f6fb3", "#8a97a5"
INCHES_A_ROW, INCHES_A_PANEL, INCHES_OF_WORDS = 0.23, 3.4, 1.2


class Bar(NamedTuple):
    """One row of a panel."""

    name: str
    p50_us: float
    p99_us: float
    is_exact: bool


def draw(found: Sequence[Found], duels: Sequence[Driven], file: Path) -> None:
    """A panel for each recording, and one for each closed loop; the fastest at the top."""
    panels = [
        (
            f"QP of {model}\n{scenario} lane change, {tier}, {mode.value}",
            [
                Bar(one.name, one.p50_us, one.p99_us, one.is_exact_enough and one.unsolved == 0)
                for one in standings
            ],
        )
        for model, scenario, tier, mode, standings in found
    ]
    panels += [
        (
            f"whole plan in closed loop,\n{scenario} lane change",
            [Bar(one.name, one.plan_p50_us, one.plan_p99_us, True) for one in summaries],
        )
        for model, scenario, summaries in duels
    ]
    rows = max(len(bars) for _, bars in panels)
    figure = Figure(
        figsize=(INCHES_A_PANEL * len(panels), INCHES_A_ROW * rows + INCHES_OF_WORDS),
        layout="constrained",
    )
    every = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, bars) in zip(every, panels, strict=True):
        ordered = sorted(bars, key=lambda bar: -bar.p50_us)
        for row, bar in enumerate(ordered):
            color = OURS if bar.name in (DEFAULT, COLD, FAST) else OTHERS
            axes.plot([bar.p50_us, bar.p99_us], [row, row], color=color, linewidth=2.0)
            axes.plot(
                bar.p50_us, row, "o", color=color, fillstyle="full" if bar.is_exact else "none"
            )
        axes.set_xscale("log")
        axes.set_title(title, fontsize=8, loc="left")
        axes.grid(axis="x", linewidth=0.4)
        axes.set_xlabel("us, median to p99", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_yticks(range(len(ordered)), [bar.name for bar in ordered])
    figure.savefig(file)
