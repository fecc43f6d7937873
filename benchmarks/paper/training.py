"""Table I and Algorithm 1: the settings of the presets, and the first steps of a training."""

import json
from datetime import datetime
from pathlib import Path
from typing import Any

from benchmarks.paper.elements import HYPERPARAMETERS, Element, Figures
from benchmarks.paper.prediction import open_data
from offline.config import PRESETS
from offline.data.dataset import cache_folder
from offline.training.run import LATEST_LINK, create_run, load_checkpoint, open_run
from offline.training.train import train
from rt_controller.report.canvas import add_legend, empty_figure, line_styles, set_log_scale
from rt_controller.report.page import Plot

AS_PAPER = ("paper-literal", "paper")
"""presets: Algorithm 1 as printed, and the one that made `mdk-net-paper`"""
LOSSES = {"single_step": "single-step loss, eq. (9)", "multi_step": "multi-step loss, eq. (10)"}
STEPS, EVALUATE_EVERY = 600, 50


def table_1() -> Element:
    """The printed hyperparameters and those of the presets. Paper: tab:hyperparams."""
    rows = {
        name: {"printed": printed, **{each: getattr(PRESETS[each], name) for each in AS_PAPER}}
        for name, printed in HYPERPARAMETERS.items()
    }
    equal = sum(len(set(row.values())) == 1 for row in rows.values())
    return Element(
        "Table I",
        "hyperparameters",
        "Those of the presets after the paper; an epoch is one mini-batch step.",
        {"equal settings": {"here": equal, "paper": len(rows)}},
        {"paper_hyperparameters": rows},
    )


def algorithm_1(folder: Path) -> Element:
    """Losses on the validation part over the first steps of a training. Paper: alg:MDK-Net.

    The runs are in `folder`; one that is there goes on from its checkpoint.
    """
    figure, panels = empty_figure(1, 2, 3.4)
    styles, rows = line_styles(AS_PAPER, ()), Figures()
    for preset in AS_PAPER:
        history = _train(preset, folder / preset)
        rows[preset] = {}
        for axes, loss in zip(panels, LOSSES, strict=True):
            values = [line["validation"][loss] for line in history]
            axes.plot([line["step"] for line in history], values, **styles[preset], label=preset)
            rows[preset] |= {f"{loss}_first": values[0], f"{loss}_last": values[-1]}
    for axes, title in zip(panels, LOSSES.values(), strict=True):
        set_log_scale(axes, "y")
        axes.set_title(title, loc="left")
        axes.set_xlabel("mini-batch steps")
    add_legend(figure, panels[0])
    literal = rows[AS_PAPER[0]]
    fall = literal["multi_step_last"] / literal["multi_step_first"]
    return Element(
        "Algorithm 1",
        f"training; here its first {STEPS} of 60,000 steps",
        "Losses of lifted states, which each model scales by itself: compare the ends of a curve, "
        "not the curves. The paper prints no losses.",
        {f"multi-step loss, last / first of {AS_PAPER[0]}": {"here": fall}},
        {"paper_losses": rows},
        {"algorithm-1": Plot(figure, "Losses on the validation part.")},
    )


def _train(preset: str, folder: Path) -> list[dict[str, Any]]:
    """The evaluations of a run of this preset, which is finished now if it was not."""
    changes = {"steps": STEPS, "evaluate_every": EVALUATE_EVERY}
    config, dataset = PRESETS[preset].model_copy(update=changes), open_data()
    latest = folder / LATEST_LINK
    run = open_run(latest) if latest.exists() else None
    if run is None or (run.config, run.data_sha256) != (config, dataset.sha256):
        data_folder = cache_folder(dataset.origin)
        run = create_run(folder, config, data_folder, dataset.sha256, datetime.now())
    checkpoint = load_checkpoint(run.last) if run.last.exists() else None
    train(config, dataset, run, resume_from=checkpoint)
    return [json.loads(line) for line in run.history.read_text(encoding="utf-8").splitlines()]
