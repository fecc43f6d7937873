"""Table I and Algorithm 1: the settings of the presets, and the beginning of a training."""

import json
from datetime import datetime
from pathlib import Path

from benchmarks.paper.elements import HYPERPARAMETERS, Element
from benchmarks.paper.prediction import open_data
from offline.config import PRESETS
from offline.data.dataset import cache_folder
from offline.training.run import LATEST_LINK, create_run, load_checkpoint, open_run
from offline.training.train import train
from rt_controller.report.canvas import add_legend, empty_figure, line_styles, set_log_scale
from rt_controller.report.page import Plot

OF_PAPER = ("paper-literal", "paper")
"""presets: Algorithm 1 as printed, and the one that made `mdk-net-paper`"""
LOSSES = {"single_step": "single-step loss, eq. (9)", "multi_step": "multi-step loss, eq. (10)"}
STEPS, EVALUATE_EVERY = 600, 50


def table_1() -> Element:
    """The printed hyperparameters and those of the presets. Paper: tab:hyperparams."""
    rows = {
        name: {"paper": printed, **{preset: getattr(PRESETS[preset], name) for preset in OF_PAPER}}
        for name, printed in HYPERPARAMETERS.items()
    }
    equal = sum(len(set(row.values())) == 1 for row in rows.values())
    return Element(
        "Table I",
        "hyperparameters, in the presets of offline-train",
        "The number of epochs is taken as that of mini-batch steps.",
        {"equal settings": {"here": equal, "paper": len(rows)}},
        {"hyperparameters": rows},
    )


def algorithm_1(folder: Path) -> Element:
    """Losses on the validation part in the first steps of a training. Paper: alg:MDK-Net.

    The runs are in `folder`; one that is there goes on from its checkpoint.
    """
    dataset, styles = open_data(), line_styles(OF_PAPER, ())
    figure, panels = empty_figure(1, 2, 3.4)
    rows = {}
    for preset in OF_PAPER:
        history = _train(preset, folder / preset)
        for axes, (loss, title) in zip(panels, LOSSES.items(), strict=True):
            values = [line["validation"][loss] for line in history]
            axes.plot([line["step"] for line in history], values, **styles[preset], label=preset)
            axes.set_title(title, loc="left")
    return Element(
        "Algorithm 1",
    )
