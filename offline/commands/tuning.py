"""The work of `offline-tune`: run the trials, print the best one and the command that trains it.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from offline.commands.dataset import open_campaign_data
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.config import TrainingConfig
from offline.experiments.backend import Backend
from offline.experiments.settings import common_fields, train_command
from offline.experiments.tuning import StudyPlan, StudyStatus, read_space, search
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
    with progress_bar("trials", plan.n_trials) as show:
        status = search(
            plan, backend, lambda now: show(min(now.ended, plan.n_trials), _status_line(now))
        )
    command = None
    if status.best is not None:
        command = train_command(space.configure(status.values), shared.folder)
    figures = {
        "space": space.name,
        "folder": str(plan.folder),
        "data_sha256": shared.sha256,
        "n_trials": status.ended,
        "n_pruned": status.pruned,
        "best_trial": status.best,
        "geometric_mean_ratio": status.value,
        "values": dict(status.values),
        "command": command,
    }
    STDOUT.print(
        f"{status.ended} of {plan.n_trials} trials. {_status_line(status)}", soft_wrap=True
    )
    if command is not None:
        STDOUT.print("Train with these settings:", style="dim")
        STDOUT.print(f"  {command}", soft_wrap=True, markup=False, highlight=False)
    return figures


def _status_line(status: StudyStatus) -> str:
    if status.best is None:
        return "no trial has ended yet"
    values = ", ".join(
        f"{field} {value:.3g}" if isinstance(value, float) else f"{field} {value}"
        for field, value in status.values.items()
    )
    return (
        f"best: trial {status.best}, {status.value:.3g} times better than the fair linear model "
        f"({values}); {status.pruned} pruned"
    )
