"""An Optuna study of training settings that several processes may work on at the same time.

The process that runs a trial holds the lock of its folder. A running trial whose lock is free was
interrupted: the next process continues it (docs/decisions/048). The random numbers of a trial
follow from the seed of the search and its number, so a study run by one process is repeatable.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from filelock import Timeout
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import Trial, TrialState

from offline.data.tasks import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.error_ratios import checkpoint_mse, error_ratios
from offline.experiments.running_command import RunningCommand, running_command
from offline.experiments.space import Space
from offline.experiments.training_task import (
    CampaignData,
    Training,
    find_run,
    folder_lock,
    run_training,
    shared_dataset,
)
from offline.training.checkpoint import Checkpoint, load_checkpoint
from offline.training.run_folder import RunFolder
from offline.training.schedule import is_evaluated
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
    pruned: int
    best: int | None
    """number of the trial with the best value"""
    value: float | None
    """its geometric mean of the error ratios"""
    values: Mapping[str, Any]
    """of the searched fields in that trial"""


def search(
    plan: StudyPlan, backend: Backend, on_status: Callable[[StudyStatus], None]
) -> tuple[StudyStatus, bool]:
    """Status of the study when no trial is left to run here; True if the search was interrupted.

    `on_status` is called at the start and after each trial.

    Raises:
        ConfigError: the folder has a study of another question, or cannot be written.
        WorkersLostError: workers died repeatedly.
    """
    with backend.active(), running_command(plan.folder) as command:
        _require_same_question(plan)
        status = _status(plan)
        on_status(status)
        for _ in run_tasks(_run_trial, [(plan, command)] * (plan.n_trials - status.ended)):
            status = _status(plan)
            on_status(status)
        return status, command.is_stopped()


def _status(plan: StudyPlan) -> StudyStatus:
    trials = _open_study(plan).get_trials(deepcopy=False)
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    best = max(complete, key=lambda trial: trial.value, default=None)
    ended = sum(trial.state.is_finished() for trial in trials)
    pruned = sum(trial.state is TrialState.PRUNED for trial in trials)
    if best is None:
        return StudyStatus(ended, pruned, None, None, {})
    return StudyStatus(ended, pruned, best.number, best.value, plan.space.values(best.params))


def _run_trial(plan: StudyPlan, command: RunningCommand) -> None:
    """Run one trial, an interrupted or a new one; none if all are taken or the command stops."""
    command.leave_ctrl_c_to_it()
    if command.is_stopped():
        return
    study = _open_study(plan)
    with ExitStack() as lock_of_trial:
        with folder_lock(plan.folder):
            trial = _choose_trial(plan, study, lock_of_trial)
        if trial is None:
            return
        config = plan.space.configure(plan.space.values(trial.params))
        training = Training(_folder(plan, trial.number), config, plan.data)
        reported = study.get_trials(deepcopy=False)[trial.number].intermediate_values

        def report(checkpoint: Checkpoint) -> None:
            if checkpoint.step not in reported:
                mse = checkpoint_mse(checkpoint, shared_dataset(plan.data.folder, plan.data.sha256))
                ratios = error_ratios(mse, plan.data.linear_mse)
                trial.report(ratios.geometric_mean, checkpoint.step)

        def on_evaluation(run: RunFolder) -> bool:
            report(load_checkpoint(run.last))
            return not trial.should_prune()

        before = find_run(training)
        if before is not None and before.last.exists():
            checkpoint = load_checkpoint(before.last)
            if is_evaluated(checkpoint.step, training.config):
                report(checkpoint)  # its process may have died before it reported
        result = run_training(training, command, on_evaluation)
        if result is None:
            return
        trial.set_user_attr("ending", result.ending)
        trial.set_user_attr("training_cpu_s", result.training_cpu_s)
        if result.ending == "pruned":
            study.tell(trial, state=TrialState.PRUNED)
        else:
            # A model that diverged or cannot be exported has no value for the sampler.
            study.tell(trial, result.ratios.geometric_mean if result.ratios else 0.0)


def _choose_trial(plan: StudyPlan, study: optuna.Study, lock_of_trial: ExitStack) -> Trial | None:
    """A trial whose folder is locked now; None: all are ended or locked by other processes."""
    trials = study.get_trials(deepcopy=False)
    running = [trial.number for trial in trials if trial.state is TrialState.RUNNING]
    for number in (*running, len(trials)):
        if number >= plan.n_trials:
            continue
        _folder(plan, number).mkdir(parents=True, exist_ok=True)
        try:
            lock_of_trial.enter_context(folder_lock(_folder(plan, number)).acquire(blocking=False))
        except Timeout:
            continue
        (seed,) = np.random.SeedSequence([plan.seed, number]).generate_state(1)
        study.sampler = optuna.samplers.TPESampler(
            seed=int(seed), n_startup_trials=RANDOM_TRIALS, constant_liar=True
        )
        trial = study.ask() if number == len(trials) else Trial(study, trials[number]._trial_id)
        for each in plan.space.parameters:
            if each.low is None or each.high is None:
                trial.suggest_categorical(each.field, each.json_choices)
            else:
                suggest = trial.suggest_int if each.is_integer else trial.suggest_float
                suggest(each.field, each.low, each.high, log=each.scale == "log")
        return trial
    return None


def _folder(plan: StudyPlan, number: int) -> Path:
    return plan.folder / "trials" / f"{number:04d}"


def _require_same_question(plan: StudyPlan) -> None:
    """Store the question in a new study; raise if the study in the folder has another one."""
    question = {
        "space": plan.space.name,
        "base": plan.space.base.model_dump(mode="json"),
        "parameters": [each.model_dump(mode="json") for each in plan.space.parameters],
        "search_seed": plan.seed,
        "data_sha256": plan.data.sha256,
    }
    with folder_lock(plan.folder):
        study = _open_study(plan)
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
