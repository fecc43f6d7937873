"""Models beside their rivals, on every test set: everything that tables and plots are made of."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from offline.bootstrap import Estimate
from offline.evaluate import Scores, mse_draws, score
from offline.predictor import Predictor
from offline.ratios import Ratio, best_of, ratio
from offline.table_units import Column, table_columns
from offline.test_sets import LIBRARY, TestSet
from rt_controller.contract.schema import Schema

FAIR_LTI = "fair lti"
"""in each state the better of one linear model for all roads and one for each"""

LTI_RIVALS = ("lti", "lti-per-curvature")

WORST_ON_NEW_ROADS = 1.5
"""times the error on the library's roads: the goal for every state"""


@dataclass(frozen=True, slots=True)
class Judgement:
    """Scores of models and rivals on the same test sets."""

    columns: tuple[Column, ...]
    dt_s: float
    judged: tuple[str, ...]
    rivals: tuple[str, ...]
    sets: tuple[TestSet, ...]
    scores: Mapping[str, Mapping[str, Scores]]
    """by name of the set, then of the model"""

    @property
    def names(self) -> tuple[str, ...]:
        """All models, those that are judged first."""
        return self.judged + self.rivals

    @property
    def steps(self) -> int:
        """K, of the horizon."""
        return int(next(iter(self.library.values())).squared.total.shape[1])

    @property
    def library(self) -> Mapping[str, Scores]:
        """By model, on the set that the others are measured against."""
        return self.scores[LIBRARY]

    def find_set(self, name: str) -> TestSet | None:
        """The set of that name, None if the models were not judged on it."""
        return next((test for test in self.sets if test.name == name), None)


def judge(
    models: Mapping[str, Predictor],
    rivals: Mapping[str, Predictor],
    sets: Sequence[TestSet],
    schema: Schema,
    on_progress: Callable[[str, str], None] = lambda model, test: None,
) -> Judgement:
    """Every model and rival on every set; `on_progress` hears which is next on which."""
    columns = table_columns(schema)
    scores: dict[str, dict[str, Scores]] = {test.name: {} for test in sets}
    for test in sets:
        for name, model in {**models, **rivals}.items():
            on_progress(name, test.name)
            scores[test.name][name] = score(model, test, columns)
    return Judgement(columns, schema.dt_s, tuple(models), tuple(rivals), tuple(sets), scores)


def ratios_to_rivals(judgement: Judgement, model: str, on: str = LIBRARY) -> dict[str, Ratio]:
    """By rival, how many times its errors are those of the model; the fair LTI first."""
    scores = judgement.scores[on]
    own = mse_draws(scores[model])
    linear = [scores[name] for name in LTI_RIVALS if name in judgement.rivals]
    fair = {FAIR_LTI: ratio(best_of(linear), own)} if linear else {}
    return fair | {name: ratio(mse_draws(scores[name]), own) for name in judgement.rivals}


def growth_from_library(judgement: Judgement, model: str, on: str) -> Ratio:
    """How many times the model's errors on another set are those on the library's roads."""
    return ratio(
        mse_draws(judgement.scores[on][model]), mse_draws(judgement.scores[LIBRARY][model])
    )


def worst_state(growth: Ratio) -> int:
    """Index of the state that suffers most; what is no number suffers without limit."""
    return int(np.argmax(np.nan_to_num(growth.by_state.value, nan=np.inf)))


def is_within_goal(growth: Estimate) -> bool:
    """Whether no state is worse than the goal for new roads allows."""
    return bool(np.all(growth.value <= WORST_ON_NEW_ROADS))
