"""An Optuna study of training settings in a search space that is read from TOML.

The trials are independent tasks. The random numbers of a trial follow from the seed of the search
and its number, so a study run by one process is repeatable. A trial whose process ended before it
is a failed one (docs/decisions/048).
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import Trial, TrialState
from pydantic import BaseModel, Field, TypeAdapter, model_validator

from offline.config import PRESETS, TrainingConfig
from offline.data.tasks import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.settings import FolderName, Preset, changed, read_toml, require_unique
from offline.experiments.training_task import (
    CampaignData,
    Training,
    checkpoint_mse,
    error_ratios,
    exclusive_folder,
    run_training,
    shared_dataset,
)
from offline.training.run_folder import RunFolder
from offline.training.state import load_checkpoint
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import option

SHIPPED = "spaces.toml"


class Parameter(BaseModel, frozen=True, extra="forbid"):
    """A field of the training configuration and the values to search."""

    field: str
    low: int | float | None = None
    high: int | float | None = None
    scale: Literal["linear", "log"] = "linear"
    choices: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _has_range_or_choices(self) -> "Parameter":
        if self.choices is not None and (self.low, self.high) == (None, None):
            return self
        if self.choices is not None or self.low is None or self.high is None:
            raise ValueError("expected either low and high, or choices")
        if not self.low < self.high:
            raise ValueError("expected low below high")
        if self.scale == "log" and not self.low > 0:
            raise ValueError("expected low above zero on a log scale")
        return self

    @property
    def is_integer(self) -> bool:
        """True if both ends of the range are integers."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    @property
    def json_choices(self) -> tuple[str, ...]:
        """The choices as JSON: Optuna stores only simple values."""
        return tuple(json.dumps(choice) for choice in self.choices or ())


@dataclass(frozen=True, slots=True)
class Space:
    """A base configuration and the parameters that are searched."""

    name: str
    base: TrainingConfig
    parameters: tuple[Parameter, ...]

    def values(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the fields for the parameters that Optuna stored."""
        with_choices = {each.field for each in self.parameters if each.choices is not None}
        return {
            field: json.loads(value) if field in with_choices else value
            for field, value in params.items()
        }

    def configure(self, values: Mapping[str, Any]) -> TrainingConfig:
        """The base configuration with these values."""
        return changed(self.base, values, self.name)


class _Space(BaseModel, extra="forbid"):
    why: str
    base: Preset
    common: dict[str, Any] = {}
    parameter: Annotated[list[Parameter], Field(min_length=1)]


_SPACES = TypeAdapter(dict[FolderName, _Space])


def read_space(name: str, file: Path | None, common: Mapping[str, Any]) -> Space:
    """The search space of that name.

    `file` None is the shipped file; `common` has the fields that options set for all trials.

    Raises:
        ConfigError: the file, the space or a field is not as expected, a choice or an end of a
            range is no value of its field, or an option sets a field that is searched.
    """
    spaces = read_toml(file, SHIPPED, "--spaces", _SPACES)
    if name not in spaces:
        known = ", ".join(spaces) or "the spaces of the file, which has none"
        raise ConfigError(f"space: expected one of {known}, found {name!r}.")
    found = spaces[name]
    base = changed(changed(PRESETS[found.base], found.common, name), common, name)
    require_unique([parameter.field for parameter in found.parameter], name)
    for parameter in found.parameter:
        if parameter.field in common:
            raise ConfigError(
                f"{name}: expected no option for a field that is searched, found "
                f"{option((parameter.field,))}. Leave it out."
            )
        for value in parameter.choices or (parameter.low, parameter.high):
            changed(base, {parameter.field: value}, f"{name}, {parameter.field}")
    return Space(name, base, tuple(found.parameter))


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


def search(
    plan: StudyPlan, backend: Backend, on_trial: Callable[[optuna.Study], None]
) -> optuna.Study:
    """The study when no trial is left; `on_trial` is called at the start and after each trial.

    Raises:
        ConfigError: the folder has a study of another question, is in use, or cannot be written.
        WorkersLostError: a worker died.
    """
    with exclusive_folder(plan.folder), backend.active():
        study = _open_study(plan)
        _require_same_question(study, plan)
        for trial in study.get_trials(states=(TrialState.RUNNING,)):
            study.tell(trial.number, state=TrialState.FAIL)
        on_trial(study)
        first, left = len(study.trials), plan.n_trials - sum(count_ended(study))
        for _ in run_tasks(_run_trial, [(plan, first + k) for k in range(left)]):
            on_trial(study)
    return study


def count_ended(study: optuna.Study) -> tuple[int, int]:
    """Number of trials with a value, and of pruned ones; failed ones are not counted."""
    states = [trial.state for trial in study.get_trials(deepcopy=False)]
    return states.count(TrialState.COMPLETE), states.count(TrialState.PRUNED)


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
