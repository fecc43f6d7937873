"""Plot of the results: the time of each solver, median to p99."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from benchmarks.peers.solvers.registry import COLD, DEFAULT

OWN_COLOR, PEER_COLOR = "#2f6fb3", "#8a97a5"
ROW_INCHES, PANEL_INCHES, TEXT_INCHES = 0.23, 3.4, 1.2


def plot(panels: Sequence[tuple[str, pd.DataFrame]], file: Path) -> None:
    """Write a figure with a panel for each title and results, the fastest at the top.

    A solver that is not accurate, or leaves problems unsolved, has a hollow marker.
    """
    rows = max(len(results) for _, results in panels)
    figure = Figure(
        figsize=(PANEL_INCHES * len(panels), ROW_INCHES * rows + TEXT_INCHES), layout="constrained"
    )
    all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, results) in zip(all_axes, panels, strict=True):
        slowest_first = results[::-1]
        for row, (name, one) in enumerate(slowest_first.iterrows()):
            p50_us, p99_us = one["p50_us"], one["p99_us"]
            is_hollow = not one["is_accurate"] or one["unsolved"] > 0
            color = OWN_COLOR if name in (DEFAULT, COLD) else PEER_COLOR
            axes.plot([p50_us, p99_us], [row, row], color=color, linewidth=2.0)
            axes.plot(p50_us, row, "o", color=color, fillstyle="none" if is_hollow else "full")
        axes.set_xscale("log")
        axes.set_title(title, fontsize=8, loc="left")
        axes.grid(axis="x", linewidth=0.4)
        axes.set_xlabel("us, median to p99", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_yticks(range(len(results)), list(slowest_first.index))
    figure.savefig(file)
