"""What `offline-tune` does: search for the settings of a training, and say which were best.

Everything is judged on the validation part. The test part is for the one model that is chosen in
the end.
"""

import json
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib

from offline.backend import Backend
from offline.campaign.attempt import attempt
from offline.campaign.claim import claimed
from offline.campaign.data import CampaignData, open_data
from offline.campaign.settings import explicit_fields, train_command
from offline.campaign.space import Space, read_space
from offline.campaign.study import Plan, Standing, standing, work
from offline.campaign.whole_file import write_json
from offline.config import PRESETS, TrainingConfig
from offline.interrupt import INTERRUPTED
from offline.parallel import as_done
from offline.terminal import CONSOLE, progress_bar
from rt_controller.contract.errors import ArtifactError, ConfigError
from rt_controller.contract.figures import write_figures

QUESTION_FILE = "question.json"
LOOK_S = 2.0


@dataclass(frozen=True, slots=True)
class Search:
    """What is to be searched."""

    space: str
    file: Path | None
    """with spaces of one's own; None: the one that ships"""
    seed: int
    trials: int
    """all in all, those of other processes and of earlier commands included"""
    common: TrainingConfig | None
    """settings that all trials get"""


def tune(
    search: Search, folder: Path, data: Path | None, backend: Backend, json_file: Path | None
) -> int:
    """Exit code of `offline-tune`: 0 with as many trials as wanted, 130 where it was stopped."""
    if search.trials < 1:
        raise ConfigError(f"--trials: expected at least 1, found {search.trials}.")
    fields = explicit_fields(search.common, {"preset": "a space with another base"})
    space = read_space(search.space, search.file, fields)
    there = open_data(data, space.base, search.common, backend)
    plan = _plan(search, space, folder, there)
    with backend.active(), attempt(folder) as current:
        _agree_on(plan)
        CONSOLE.print(f"study {folder}\ndata {there.folder}", soft_wrap=True)
        # Read where the backend is active: it knows how many may work.
        workers = joblib.effective_n_jobs(-1 if backend.address else backend.jobs)
        with _watched(plan):
            tasks = [(plan, current, os.getpid())] * min(workers, search.trials)
            for _ in as_done(work, tasks):
                pass
        is_stopped = not current.is_wanted()
    return _say(plan, standing(plan), json_file, is_stopped)


def _plan(search: Search, space: Space, folder: Path, there: CampaignData) -> Plan:
    base = there.configure(space.base)
    return Plan(
        folder=folder.resolve(),
        space=Space(space.name, space.why, base, space.parameters),
        seed=search.seed,
        trials=search.trials,
        data_folder=there.folder.resolve(),
        data_sha256=there.sha256,
        rivals=there.rivals,
    )


def _agree_on(plan: Plan) -> None:
    """Return if the folder's study asks the same question, or none yet.

    Raises:
        ConfigError: it asks another one.
    """
    ours: dict[str, Any] = {
        "space": plan.space.name,
        "base": plan.space.base.model_dump(mode="json"),
        "parameters": [p.model_dump(mode="json") for p in plan.space.parameters],
        "search_seed": plan.seed,
        "data_sha256": plan.data_sha256,
    }
    file = plan.folder / QUESTION_FILE
    with claimed(plan.folder, lambda: False):
        if not file.exists():
            write_json(file, ours)
            return
    try:
        theirs = json.loads(file.read_text(encoding="utf-8"))
        changed = [name for name, value in ours.items() if theirs[name] != value]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ArtifactError(
            f"{file}: expected the question of a study, found something else ({error}). Choose "
            f"another --folder."
        ) from error
    if changed:
        raise ConfigError(
            f"--folder {plan.folder}: expected a study of the same question, found one that "
            f"differs in {', '.join(changed)}. Choose another --folder, or the same options."
        )


@contextmanager
def _watched(plan: Plan) -> Iterator[None]:
    """Show how the study goes, whoever works on it."""
    over = threading.Event()
    with progress_bar("trials", plan.trials) as show:

        def look() -> None:
            while not over.wait(LOOK_S):
                now = standing(plan)
                show(min(now.ended, plan.trials), describe(now))

        watcher = threading.Thread(target=look, daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            watcher.join()
            now = standing(plan)
            show(min(now.ended, plan.trials), describe(now))


def describe(now: Standing) -> str:
    """Where a study stands, in one line."""
    if now.best is None:
        return "no trial has come to its end yet"
    settings = ", ".join(f"{field} {_short(value)}" for field, value in now.values.items())
    return (
        f"best: trial {now.best}, {now.value:.3g} times better than the fair linear model "
        f"({settings}); {now.pruned} pruned"
    )


def _say(plan: Plan, now: Standing, json_file: Path | None, is_stopped: bool) -> int:
    config = plan.space.configure(now.values)
    preset = PRESETS[config.preset]
    command = None if now.best is None else train_command(config, preset, plan.data_folder)
    write_figures(
        json_file,
        {
            "space": plan.space.name,
            "folder": str(plan.folder),
            "data_sha256": plan.data_sha256,
            "n_trials": now.ended,
            "n_pruned": now.pruned,
            "is_finished": now.ended >= plan.trials,
            "best_trial": now.best,
            "geometric_mean_ratio": now.value,
            "values": dict(now.values),
            "command": command,
        },
    )
    CONSOLE.print(f"{now.ended} of {plan.trials} trials. {describe(now)}", soft_wrap=True)
    if command is not None:
        CONSOLE.print("Train with it:", style="dim")
        CONSOLE.print(f"  {command}", soft_wrap=True, markup=False, highlight=False)
    if now.ended >= plan.trials:
        return 0
    if is_stopped:
        CONSOLE.print("Stopped; nothing is lost. Run the same command again to go on.")
        return INTERRUPTED
    CONSOLE.print("The other trials are in the hands of other processes that work on this study.")
    return 0


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
