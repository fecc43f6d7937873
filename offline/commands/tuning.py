"""The work of `offline-tune`: run the trials, print the best one and the command that trains it.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import optuna

from offline.commands.dataset import open_campaign_data
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.config import TrainingConfig
from offline.experiments.backend import Backend
from offline.experiments.settings import common_fields, train_command
from offline.experiments.tuning import Space, StudyPlan, count_ended, read_space, search
from rt_controller.contract.errors import ConfigError


def tune(
    name: str,
    spaces: Path | None,
    search_seed: int,
    n_trials: int,
    common: TrainingConfig | None,
    folder: Path,
    data: Path | None,
    backend: Backend,
) -> dict[str, Any]:
    """Figures of `offline-tune`."""
    if n_trials < 1:
        raise ConfigError(f"--trials: expected at least 1, found {n_trials}.")
    fields = common_fields(common, {"preset": "a space with another base"})
    space = read_space(name, spaces, fields)
    shared, (base,) = open_campaign_data(data, [space.base], common, backend)
    space = replace(space, base=base)
    plan = StudyPlan(folder.resolve(), space, search_seed, n_trials, shared)
    STDERR.print(f"study {folder}\ndata {shared.folder}", soft_wrap=True)
    with progress_bar("trials", n_trials) as show:
        study = search(
            plan,
            backend,
            lambda now: show(min(sum(count_ended(now)), n_trials), _status_line(now, space)),
        )
    complete, pruned = count_ended(study)
    best = study.best_trial if complete else None
    values = space.values(best.params) if best else {}
    command = train_command(space.configure(values), shared.folder) if best else None
    figures = {
        "space": space.name,
        "folder": str(plan.folder),
        "data_sha256": shared.sha256,
        "n_trials": complete + pruned,
        "n_pruned": pruned,
        "best_trial": best and best.number,
        "geometric_mean_ratio": best and best.value,
        "values": values,
        "command": command,
    }
    STDOUT.print(
        f"{complete + pruned} of {n_trials} trials. {_status_line(study, space)}", soft_wrap=True
    )
    if command is not None:
        STDOUT.print("Train with these settings:", style="dim")
        STDOUT.print(f"  {command}", soft_wrap=True, markup=False, highlight=False)
    return figures


def _status_line(study: optuna.Study, space: Space) -> str:
    complete, pruned = count_ended(study)
    if not complete:
        return "no trial has ended yet"
    best = study.best_trial
    values = ", ".join(
        f"{field} {value:.3g}" if isinstance(value, float) else f"{field} {value}"
        for field, value in space.values(best.params).items()
    )
    return (
        f"best: trial {best.number}, {best.value:.3g} times better than the fair linear model "
        f"({values}); {pruned} pruned"
    )
