"""`offline-tune`: run the trials, print the best one and the command that trains it.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from offline.commands.options import (
    RUNS,
    THIS_MACHINE,
    Config,
    DataFolder,
    JsonFile,
    require_ready,
)
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.experiments.backend import Backend
from rt_controller.contract.errors import ConfigError, require_packages
from rt_controller.contract.figures import write_figures

if TYPE_CHECKING:
    from optuna import Study


def tune(
    space: str = "method",
    *,
    config: Config = None,
    trials: int = 50,
    search_seed: int = 0,
    spaces: Path | None = None,
    folder: Path | None = None,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json_file: JsonFile = None,
) -> None:
    """Search for the settings whose model is furthest ahead of a linear one on validation data.

    Ctrl-C stops; the same command goes on, with new trials for those that did not end. Options of
    offline-train, such as --steps, apply to all trials. docs/experiments.md has the file of search
    spaces.

    Args:
        space: a search space of the file: method, structure, paper-weights
        trials: trials in total, including those of earlier commands
        search_seed: seed of the search; --seed is that of every training
        spaces: TOML file with search spaces; default: the shipped one
        folder: folder of the study; default: runs/tuning-SPACE
    """
    require_ready(json_file)
    require_packages("offline,tune", ("optuna",), "offline-tune")
    from offline.commands.dataset import open_campaign_data
    from offline.experiments.settings import common_fields, train_command
    from offline.experiments.tuning import StudyPlan, count_ended, read_space, search

    if trials < 1:
        raise ConfigError(f"--trials: expected at least 1, found {trials}.")
    common = common_fields(config, {"preset": "a space with another base"})
    searched, base = read_space(space, spaces, common)
    shared, of_data = open_campaign_data(data, base, config, backend)
    path = (folder or RUNS / f"tuning-{space}").resolve()
    base = base.model_copy(update=of_data)
    plan = StudyPlan(path, searched, base, search_seed, trials, shared)
    STDERR.print(f"study {path}\ndata {shared.folder}", soft_wrap=True)

    def on_trial(study: "Study") -> None:
        complete, pruned = count_ended(study)
        best = f"best {study.best_value:.3g}, {pruned} pruned" if complete else "no trial has ended"
        show(min(complete + pruned, trials), best)

    with progress_bar("trials", trials) as show:
        study = search(plan, backend, on_trial)
    complete, pruned = count_ended(study)
    best = study.best_trial if complete and study.best_value > 0.0 else None
    command = best and train_command(plan.configure(best.params), shared.folder)
    figures = {
        "space": space,
        "folder": str(path),
        "data_sha256": shared.sha256,
        "n_trials": complete + pruned,
        "n_pruned": pruned,
        "best_trial": best and best.number,
        "geometric_mean_ratio": best and best.value,
        "values": searched.values(best.params) if best else {},
        "command": command,
    }
    write_figures(json_file, figures)
    text = f"{complete + pruned} of {trials} trials, {pruned} of them pruned"
    if best is None and complete:
        text += (
            "\nExpected a trial with a model that can be exported, found none: each diverged, or "
            "grows under inputs. result.json of each trial has the reason. Use more --steps."
        )
    if best is not None:
        text += (
            f"\nTrial {best.number} is {best.value:.3g} times better than the fair linear model. "
            f"Train with its settings:\n  {command}"
        )
    STDOUT.print(text, soft_wrap=True, markup=False, highlight=False)
