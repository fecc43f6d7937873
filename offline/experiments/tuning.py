"""An Optuna study of training settings in a search space that is read from TOML.

The trials are independent tasks. The random numbers of a trial follow from the seed of the search
and its number, so a study run by one process is repeatable (docs/decisions/048).
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState
from pydantic import BaseModel, Field, TypeAdapter, model_validator

from offline.config import PRESETS, TrainingConfig
from offline.data.generate import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.settings import (
    FolderName,
    Preset,
    changed,
    read_toml,
    require_consistent,
)
from offline.experiments.training_task import (
    CampaignData,
    geometric_mean,
    make_folder,
    require_same,
    run_training,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError

SHIPPED = "spaces.toml"


class Parameter(BaseModel, frozen=True, extra="forbid"):
    """A field of the training configuration and the values to search."""

    field: str
    low: int | float | None = None
    high: int | float | None = None
    scale: Literal["linear", "log"] = "linear"
    choices: tuple[Any, ...] | None = None

    @model_validator(mode="after")
    def _is_distribution(self) -> "Parameter":
        _ = self.distribution
        return self

    @property
    def distribution(self) -> BaseDistribution:
        """For Optuna: of integers if both ends are; choices as JSON, it stores only simple values.

        Raises:
            ValueError: neither a range nor choices, both, or a range that is empty.
        """
        low, high, is_log = self.low, self.high, self.scale == "log"
        if self.choices is not None and (low, high) == (None, None):
            return CategoricalDistribution([json.dumps(choice) for choice in self.choices])
        if self.choices is not None or low is None or high is None:
            raise ValueError("expected either low and high, or choices")
        if not low < high:
            raise ValueError(f"expected low below high, found {low} and {high}")
        if isinstance(low, int) and isinstance(high, int):
            return IntDistribution(low, high, log=is_log)
        return FloatDistribution(low, high, log=is_log)


class Space(BaseModel, frozen=True, extra="forbid"):
    """A base configuration and the parameters that are searched."""

    why: str
    base: Preset
    common: dict[str, Any] = {}
    parameter: Annotated[tuple[Parameter, ...], Field(min_length=1)]

    def values(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the fields for the parameters that Optuna stored."""
        return {
            each.field: json.loads(params[each.field]) if each.choices else params[each.field]
            for each in self.parameter
        }


_SPACES = TypeAdapter(dict[FolderName, Space])


def read_space(
    name: str, file: Path | None, common: Mapping[str, Any]
) -> tuple[Space, TrainingConfig]:
    """The search space of that name, and its configuration before the search.

    `file` None is the shipped file; `common` has the fields that options set for all trials.

    Raises:
        ConfigError: the file, the space or a field is not as expected, a choice or an end of a
            range is no value of its field, or an option sets a field that is searched.
    """
    spaces = read_toml(file, SHIPPED, "--spaces", _SPACES)
    if name not in spaces:
        known = ", ".join(spaces) or "the spaces of the file, which has none"
        raise ConfigError(f"space: expected one of {known}, found {name!r}.")
    space = spaces[name]
    base = changed(changed(PRESETS[space.base], space.common, name), common, name)
    fields = [parameter.field for parameter in space.parameter]
    require_consistent(name, fields, fields, common)
    for parameter in space.parameter:
        for value in parameter.choices or (parameter.low, parameter.high):
            changed(base, {parameter.field: value}, f"{name}, {parameter.field}")
    return space, base


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
    base: TrainingConfig
    """of all trainings, with their seed"""
    seed: int
    """of the search"""
    n_trials: int
    data: CampaignData

    def open_study(self, draw: int = 0) -> optuna.Study:
        """The study in the folder, a new one if there is none; its sampler has these numbers."""
        (seed,) = np.random.SeedSequence([self.seed, draw]).generate_state(1)
        return optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(self.folder / JOURNAL_FILE))),
            study_name="study",
            load_if_exists=True,
            direction="maximize",
            sampler=optuna.samplers.TPESampler(
                seed=int(seed), n_startup_trials=RANDOM_TRIALS, constant_liar=True
            ),
            pruner=optuna.pruners.MedianPruner(
                n_startup_trials=UNPRUNED_TRIALS,
                n_warmup_steps=round(UNPRUNED_SHARE * self.base.steps),
            ),
        )

    @property
    def question(self) -> dict[str, Any]:
        """What may not change between two commands on one study."""
        return {
            "base": self.base.model_dump(mode="json"),
            "parameters": [each.model_dump(mode="json") for each in self.space.parameter],
            "search_seed": self.seed,
            "data_sha256": self.data.sha256,
        }

    def configure(self, params: Mapping[str, Any]) -> TrainingConfig:
        """The configuration of a trial with these parameters."""
        return changed(self.base, self.space.values(params), f"trial in {self.folder}")


def search(
    plan: StudyPlan, backend: Backend, on_trial: Callable[[optuna.Study], None]
) -> optuna.Study:
    """The study when no trial is left; `on_trial` is called at the start and after each trial.

    Raises:
        ConfigError: the folder has a study of another question, or cannot be written.
        WorkersLostError: a worker died.
    """
    make_folder(plan.folder)
    with backend.active():
        study = plan.open_study()
        if QUESTION not in study.user_attrs:
            study.set_user_attr(QUESTION, plan.question)
        require_same(plan.folder, plan.question, study.user_attrs[QUESTION])
        on_trial(study)
        first, left = len(study.trials), plan.n_trials - sum(count_ended(study))
        for _ in run_tasks(_run_trial, [(plan, first + k) for k in range(left)]):
            on_trial(study)
    return study


def count_ended(study: optuna.Study) -> tuple[int, int]:
    """Number of trials with a value, and of pruned ones; interrupted ones are not counted."""
    states = [trial.state for trial in study.get_trials(deepcopy=False)]
    return states.count(TrialState.COMPLETE), states.count(TrialState.PRUNED)


def _run_trial(plan: StudyPlan, draw: int) -> None:
    """Run one trial: its value is the geometric mean of the error ratios, 0 without a model."""
    study = plan.open_study(draw)
    trial = study.ask({each.field: each.distribution for each in plan.space.parameter})

    def on_evaluation(step: int, mse: Array) -> None:
        trial.report(geometric_mean(plan.data.ratios(mse).values()), step)
        if trial.should_prune():
            raise optuna.TrialPruned

    folder = plan.folder / "trials" / f"{trial.number:04d}"
    try:
        result = run_training(folder, plan.configure(trial.params), plan.data, on_evaluation)
    except optuna.TrialPruned:
        study.tell(trial, state=TrialState.PRUNED)
    except BaseException:
        study.tell(trial, state=TrialState.FAIL)
        raise
    else:
        trial.set_user_attr("ending", result.ending)
        study.tell(trial, result.geometric_mean_ratio or 0.0)
