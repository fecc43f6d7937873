"""An Optuna study of training settings; its trials are independent tasks.

The random numbers of a trial follow from the seed of the search and its number, so a study run by
one process is repeatable. A trial whose process ended before it is a failed one
(docs/decisions/048).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import Trial, TrialState

from offline.data.tasks import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.error_ratios import checkpoint_mse, error_ratios
from offline.experiments.space import Space
from offline.experiments.training_task import (
    CampaignData,
    Training,
    exclusive_folder,
    run_training,
    shared_dataset,
)
from offline.training.checkpoint import load_checkpoint
from offline.training.run_folder import RunFolder
from rt_controller.contract.errors import ConfigError

JOURNAL_FILE = "study.journal"
QUESTION = "question"
RANDOM_TRIALS = 10
"""before the sampler uses the values of earlier trials"""
UNPRUNED_TRIALS = 5
"""before any trial is compared with the median"""
UNPRUNED_SHARE = 0.3
"""of the steps of a training: a loss says little as long as the horizon grows"""

optuna.logging.set_verbosity(optuna.logging.WARNING)


@dataclass(frozen=True, slots=True)
class StudyPlan:
    """What a study searches, on which data, and for how long."""

    folder: Path
    space: Space
    seed: int
    """of the search; the seed of the trainings is in the base of the space"""
    n_trials: int
    data: CampaignData


@dataclass(frozen=True, slots=True)
class StudyStatus:
    """Progress of a study."""

    ended: int
    """trials with a value, and pruned ones; failed ones are not counted"""
    pruned: int
    best: int | None
    """number of the trial with the best value"""
    value: float | None
    """its geometric mean of the error ratios"""
    values: Mapping[str, Any]
    """of the searched fields in that trial"""


def search(
    plan: StudyPlan, backend: Backend, on_status: Callable[[StudyStatus], None]
) -> StudyStatus:
    """Status of the study when no trial is left.

    `on_status` is called at the start and after each trial.

    Raises:
        ConfigError: the folder has a study of another question, is in use, or cannot be written.
        WorkersLostError: a worker died.
    """
    with exclusive_folder(plan.folder), backend.active():
        study = _open_study(plan)
        _require_same_question(study, plan)
        for trial in study.get_trials(states=(TrialState.RUNNING,)):
            study.tell(trial.number, state=TrialState.FAIL)
        status = _status(study, plan.space)
        on_status(status)
        first, left = len(study.trials), plan.n_trials - status.ended
        for _ in run_tasks(_run_trial, [(plan, first + k) for k in range(left)]):
            status = _status(study, plan.space)
            on_status(status)
    return status


def _status(study: optuna.Study, space: Space) -> StudyStatus:
    trials = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    best = max(complete, key=lambda trial: trial.value, default=None)
    counts = (len(trials), len(trials) - len(complete))
    if best is None:
        return StudyStatus(*counts, None, None, {})
    return StudyStatus(*counts, best.number, best.value, space.values(best.params))


def _run_trial(plan: StudyPlan, draw: int) -> None:
    """Run one trial; `draw` is the number of its random numbers."""
    (seed,) = np.random.SeedSequence([plan.seed, draw]).generate_state(1)
    study = _open_study(plan)
    study.sampler = optuna.samplers.TPESampler(
        seed=int(seed), n_startup_trials=RANDOM_TRIALS, constant_liar=True
    )
    study.optimize(partial(_value, plan), n_trials=1)


def _value(plan: StudyPlan, trial: Trial) -> float:
    """Geometric mean of the error ratios; 0 if the model diverged or cannot be exported."""
    for each in plan.space.parameters:
        if each.low is None or each.high is None:
            trial.suggest_categorical(each.field, each.json_choices)
        else:
            suggest = trial.suggest_int if each.is_integer else trial.suggest_float
            suggest(each.field, each.low, each.high, log=each.scale == "log")
    config = plan.space.configure(plan.space.values(trial.params))
    training = Training(plan.folder / "trials" / f"{trial.number:04d}", config, plan.data)

    def on_evaluation(run: RunFolder) -> bool:
        checkpoint = load_checkpoint(run.last)
        mse = checkpoint_mse(checkpoint, shared_dataset(plan.data.folder, plan.data.sha256))
        ratios = error_ratios(mse, plan.data.linear_mse)
        trial.report(ratios.geometric_mean, checkpoint.step)
        return not trial.should_prune()

    result = run_training(training, on_evaluation)
    trial.set_user_attr("ending", result.ending)
    trial.set_user_attr("training_cpu_s", result.training_cpu_s)
    if result.ending == "pruned":
        raise optuna.TrialPruned
    return result.ratios.geometric_mean if result.ratios else 0.0


def _require_same_question(study: optuna.Study, plan: StudyPlan) -> None:
    """Store the question in a new study; raise if the study in the folder has another one."""
    question = {
        "space": plan.space.name,
        "base": plan.space.base.model_dump(mode="json"),
        "parameters": [each.model_dump(mode="json") for each in plan.space.parameters],
        "search_seed": plan.seed,
        "data_sha256": plan.data.sha256,
    }
    if QUESTION not in study.user_attrs:
        study.set_user_attr(QUESTION, question)
    stored = study.user_attrs[QUESTION]
    different = [name for name, value in question.items() if stored.get(name) != value]
    if different:
        raise ConfigError(
            f"--folder {plan.folder}: expected a study of the same question, found one that "
            f"differs in {', '.join(different)}. Choose another --folder, or the same options."
        )


def _open_study(plan: StudyPlan) -> optuna.Study:
    """The study in the plan's folder, a new one if there is none."""
    return optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(plan.folder / JOURNAL_FILE))),
        study_name="study",
        load_if_exists=True,
        direction="maximize",
        pruner=optuna.pruners.MedianPruner(
            n_startup_trials=UNPRUNED_TRIALS,
            n_warmup_steps=round(UNPRUNED_SHARE * plan.space.base.steps),
        ),
    )
