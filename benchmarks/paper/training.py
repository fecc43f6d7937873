"""Table I and Algorithm 1: settings of the presets, a data set like the paper's, and trainings."""

import json
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.paper.elements import HYPERPARAMETERS, Element, Figures
from offline.config import PRESETS
from offline.data.dataset import Dataset, cache_folder, exists, load_dataset
from offline.data.generate import make_dataset, simulated_origin
from offline.data.manifest import PARTS, Simulated
from offline.data.recipe import Recipe
from offline.training.run import LATEST_LINK, RunFolder, create_run, load_checkpoint, open_run
from offline.training.train import train
from rt_controller.report.canvas import add_legend, empty_figure, line_styles, set_log_scale
from rt_controller.report.page import Plot

LARGEST_STEER_DEG = 40.0
SEED = 2_503
"""of no other data set: no model was trained on these episodes"""
EPISODES = {"train": 1_200, "validation": 200, "test": 600}
"""600 have 480 slices of each curvature; the paper has 7,000 in all"""
AS_PAPER = ("paper-literal", "paper")
"""presets: Algorithm 1 as printed, and the one that made `mdk-net-paper`"""
LOSSES = {"single_step": "single-step loss, eq. (9)", "multi_step": "multi-step loss, eq. (10)"}
STEPS, EVALUATE_EVERY = 1_500, 100


def table_1() -> Element:
    """The printed hyperparameters and those of the presets. Paper: tab:hyperparams."""
    rows = {
        name: {"printed": printed, **{each: getattr(PRESETS[each], name) for each in AS_PAPER}}
        for name, printed in HYPERPARAMETERS.items()
    }
    equal = sum(len(set(row.values())) == 1 for row in rows.values())
    return Element(
        "Table I",
        "Hyperparameters, here of the presets after the paper. An epoch is one mini-batch step.",
        {"equal hyperparameters": {"here": equal, "paper": len(rows)}},
        {"paper_hyperparameters": rows},
    )


@cache
def open_data() -> Dataset:
    """The data set with the bounds of the paper, from the cache or made now on all cores."""
    origin = _origin()
    folder = cache_folder(origin)
    if exists(folder):
        return load_dataset(folder)
    part = np.repeat(np.arange(len(PARTS), dtype=np.int8), [EPISODES[name] for name in PARTS])
    return make_dataset(folder, origin, part)


def _origin() -> Simulated:
    recipe = Recipe(largest_steer_deg=LARGEST_STEER_DEG)
    return simulated_origin(recipe, sum(EPISODES.values()), SEED)


def finished_run(preset: str, folder: Path) -> RunFolder:
    """The run of this preset below `folder`; it begins or goes on now if it is not finished."""
    changes = {"steps": STEPS, "evaluate_every": EVALUATE_EVERY}
    config, dataset = PRESETS[preset].model_copy(update=changes), open_data()
    latest = folder / preset / LATEST_LINK
    run = open_run(latest) if latest.exists() else None
    if run is None or (run.config, run.data_sha256) != (config, dataset.sha256):
        data_folder = cache_folder(_origin())
        run = create_run(folder / preset, config, data_folder, dataset.sha256, datetime.now())
    checkpoint = load_checkpoint(run.last) if run.last.exists() else None
    train(config, dataset, run, resume_from=checkpoint)
    return run


def algorithm_1(folder: Path) -> Element:
    """Losses on the validation part over the steps of `finished_run`. Paper: alg:MDK-Net."""
    figure, panels = empty_figure(1, 2, 3.4)
    styles, rows, summary = line_styles(AS_PAPER, ()), Figures(), Figures()
    for preset in AS_PAPER:
        text = finished_run(preset, folder).history.read_text(encoding="utf-8")
        history = [json.loads(line) for line in text.splitlines()]
        rows[preset] = {}
        for axes, (loss, title) in zip(panels, LOSSES.items(), strict=True):
            values = [line["validation"][loss] for line in history]
            axes.plot([line["step"] for line in history], values, **styles[preset], label=preset)
            axes.set_title(title, loc="left")
            rows[preset] |= {f"{loss}_first": values[0], f"{loss}_last": values[-1]}
        fall = rows[preset]["multi_step_last"] / rows[preset]["multi_step_first"]
        summary[f"last over first multi-step loss of {preset}"] = {"here": fall}
    for axes in panels:
        set_log_scale(axes, "y")
        axes.set_xlabel("mini-batch steps")
    add_legend(figure, panels[0])
    return Element(
        "Algorithm 1",
        f"Training, here its first {STEPS:,} of 60,000 steps. Each model scales its lifted states, "
        "so compare the ends of a curve, not two curves. The paper prints no losses.",
        summary,
        {"paper_losses": rows},
        {"algorithm-1": Plot(figure, "Losses on the validation part.")},
    )
