"""A search that any number of processes may work on, and that outlives each of them.

The study is a journal in the campaign's folder, and every trial has a folder of its own. A trial
whose process died or was stopped is nobody's: the next process takes it up at its checkpoint
before it begins another one. The dice of a trial follow from the study's seed and the trial's
number, so a study that one process did alone is the same whether or not it was interrupted.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

from offline.campaign.attempt import Attempt
from offline.campaign.claim import claimed
from offline.campaign.result import Result
from offline.campaign.score import assess, score
from offline.campaign.space import Parameter, Space
from offline.campaign.trainings import (
    Training,
    find_run,
    leave_ctrl_c_to,
    open_shared,
    run_training,
)
from offline.checkpoint import Checkpoint, load_checkpoint
from offline.run_folder import RunFolder
from offline.schedule import is_evaluated
from offline.train import Progress

JOURNAL_FILE = "study.journal"
TRIALS = "trials"
TRAINING = "training"
NAME = "study"

TRIALS_AT_RANDOM = 10
"""before the sampler learns from those before"""
TRIALS_UNPRUNED = 5
"""that the median is of before anything is pruned"""
SHARE_UNPRUNED = 0.3
"""of a training's steps: as long as the horizon still grows, a loss says little"""

optuna.logging.set_verbosity(optuna.logging.WARNING)


@dataclass(frozen=True, slots=True)
class Plan:
    """What a study searches, on which data, and how long."""

    folder: Path
    space: Space
    seed: int
    """of the search; that of the trainings is in the space's base"""
    trials: int
    data_folder: Path
    data_sha256: str
    rivals: tuple[float, ...]
    """mean squared errors (n,) of the fair linear model on the validation part"""


@dataclass(frozen=True, slots=True)
class Standing:
    """How far a study has come."""

    ended: int
    """trials that will not be touched again"""
    pruned: int
    best: int | None
    """number of the trial with the best value"""
    value: float | None
    """its geometric mean of the error ratios"""
    values: Mapping[str, Any]
    """of the parameters' fields in that trial"""


def work(plan: Plan, attempt: Attempt, leader_pid: int) -> int:
    """Trials that were brought to their end here, until the study has as many as planned."""
    leave_ctrl_c_to(leader_pid)
    study = open_study(plan)
    ended = 0
    while attempt.is_wanted():
        with _a_trial(plan, study, attempt) as trial:
            if trial is None:
                break
            ended += _end(plan, study, trial, attempt, leader_pid)
    return ended


def open_study(plan: Plan) -> optuna.Study:
    """The study in the plan's folder, begun now if there is none."""
    return optuna.create_study(
        storage=_storage(plan),
        study_name=NAME,
        load_if_exists=True,
        direction="maximize",
        pruner=optuna.pruners.MedianPruner(
            n_startup_trials=TRIALS_UNPRUNED,
            n_warmup_steps=round(SHARE_UNPRUNED * plan.space.base.steps),
        ),
    )


def standing(plan: Plan) -> Standing:
    """How far the study in the plan's folder has come."""
    trials = open_study(plan).get_trials(deepcopy=False)
    complete = [trial for trial in trials if trial.state is TrialState.COMPLETE]
    ended = [trial for trial in trials if trial.state.is_finished()]
    best = max(complete, key=lambda trial: trial.values[0], default=None)
    return Standing(
        ended=len(ended),
        pruned=sum(trial.state is TrialState.PRUNED for trial in ended),
        best=None if best is None else best.number,
        value=None if best is None else best.values[0],
        values={} if best is None else _values(plan.space, best.params),
    )


@contextmanager
def _a_trial(plan: Plan, study: optuna.Study, attempt: Attempt) -> Iterator[Trial | None]:
    """A trial of one's own: one that nobody works on any more, or a new one; None: all are given.

    Who chooses holds the study's folder, so no two choose the same; who works holds the trial's.
    """
    with ExitStack() as until_ended:
        with claimed(plan.folder, attempt.should_stop()) as is_ours:
            trial = _choose(plan, study, until_ended) if is_ours else None
        yield trial


def _choose(plan: Plan, study: optuna.Study, until_ended: ExitStack) -> Trial | None:
    trials = study.get_trials(deepcopy=False)
    for open_trial in trials:
        if open_trial.state is TrialState.RUNNING and _claim(plan, open_trial.number, until_ended):
            return _take_up(plan, study, open_trial)
    if len(trials) >= plan.trials:
        return None
    _claim(plan, len(trials), until_ended)
    _roll(plan, study, len(trials))
    trial = study.ask()
    for parameter in plan.space.parameters:
        _suggest(trial, parameter)
    return trial


def _claim(plan: Plan, number: int, until_ended: ExitStack) -> bool:
    folder = _folder(plan, number)
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as if_ours:
        is_ours = if_ours.enter_context(claimed(folder, lambda: True))
        if is_ours:
            until_ended.push(if_ours.pop_all())
    return is_ours


def _take_up(plan: Plan, study: optuna.Study, open_trial: FrozenTrial) -> Trial:
    storage = _storage(plan)
    study_id = storage.get_study_id_from_name(NAME)
    number = storage.get_trial_id_from_study_id_trial_number(study_id, open_trial.number)
    _roll(plan, study, open_trial.number)
    trial = Trial(study, number)
    for parameter in plan.space.parameters:  # it may have died while it drew them
        _suggest(trial, parameter)
    return trial


def _end(plan: Plan, study: optuna.Study, trial: Trial, attempt: Attempt, leader_pid: int) -> bool:
    """Whether the trial came to its end."""
    training = _training(plan, trial)
    known = set(study.get_trials(deepcopy=False)[trial.number].intermediate_values)

    def report(checkpoint: Checkpoint) -> None:
        if checkpoint.step not in known:
            dataset = open_shared(plan.data_folder, plan.data_sha256)
            errors = assess(checkpoint, dataset).errors
            trial.report(score(errors, np.asarray(plan.rivals)).geometric_mean, checkpoint.step)

    def on_evaluation(progress: Progress, run: RunFolder) -> bool:
        report(load_checkpoint(run.last))
        return not trial.should_prune()

    before = find_run(training)
    if before is not None and before.last.exists():
        checkpoint = load_checkpoint(before.last)
        if is_evaluated(checkpoint.step, training.config):
            report(checkpoint)  # its process may have died before it could
    result = run_training(training, attempt, leader_pid, on_evaluation)
    if result is None:
        return False
    _tell(study, trial, result)
    return True


def _tell(study: optuna.Study, trial: Trial, result: Result) -> None:
    trial.set_user_attr("ending", result.ending)
    trial.set_user_attr("training_cpu_s", result.training_cpu_s)
    if result.ending == "pruned":
        study.tell(trial, state=TrialState.PRUNED)
        return
    # A model that diverged or may not drive predicts nothing: the sampler shall know.
    study.tell(trial, result.score.geometric_mean if result.score else 0.0)


def _training(plan: Plan, trial: Trial) -> Training:
    return Training(
        folder=_folder(plan, trial.number) / TRAINING,
        config=plan.space.configure(_values(plan.space, trial.params)),
        data_folder=plan.data_folder,
        data_sha256=plan.data_sha256,
        rivals=plan.rivals,
    )


def _suggest(trial: Trial, parameter: Parameter) -> None:
    if parameter.low is None or parameter.high is None:
        trial.suggest_categorical(parameter.field, parameter.words)
    elif parameter.is_whole:
        log = parameter.scale == "log"
        trial.suggest_int(parameter.field, int(parameter.low), int(parameter.high), log=log)
    else:
        log = parameter.scale == "log"
        trial.suggest_float(parameter.field, parameter.low, parameter.high, log=log)


def _values(space: Space, params: Mapping[str, Any]) -> dict[str, Any]:
    """What the fields get: choices are kept as JSON."""
    chosen = {parameter.field for parameter in space.parameters if parameter.choices is not None}
    return {
        field: json.loads(value) if field in chosen else value for field, value in params.items()
    }


def _roll(plan: Plan, study: optuna.Study, number: int) -> None:
    """Give the study the dice of that trial."""
    (seed,) = np.random.SeedSequence([plan.seed, number]).generate_state(1)
    study.sampler = optuna.samplers.TPESampler(
        seed=int(seed), n_startup_trials=TRIALS_AT_RANDOM, constant_liar=True
    )


def _storage(plan: Plan) -> JournalStorage:
    return JournalStorage(JournalFileBackend(str(plan.folder / JOURNAL_FILE)))


def _folder(plan: Plan, number: int) -> Path:
    return plan.folder / TRIALS / f"{number:04d}"
