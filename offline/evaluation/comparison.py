"""Models compared with baselines: one long table of errors, a row a part, model and state.

`--json` writes the table; the tables of the terminal, the model card, the page and the documents
are views of it.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.evaluation.bootstrap import (
    CONFIDENCE,
    RESAMPLES,
    SEED,
    Estimate,
    estimate,
    mean_draws,
)
from offline.evaluation.metrics import (
    StateUnit,
    absolute_errors,
    geometric_mean,
    mean_names,
    ratios_of,
    state_units,
)
from offline.evaluation.parts import Part
from offline.evaluation.predictor import Predictor
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema

FAIR_LTI = "fair lti"
"""for each state the better of `LTI_BASELINES`, chosen anew in every draw"""

LTI_BASELINES = ("lti", "lti-per-curvature")


class Row(NamedTuple):
    """Error of one model in one state on one part."""

    part: str
    model: str
    state: str
    """without its unit, or a name of `mean_names`, which has ratios only"""
    unit: str
    trajectories: int
    diverged: int
    """trajectories with a prediction that is not finite"""
    mse: Estimate
    """in the square of `unit`, over all steps and trajectories. Paper: Table I"""
    over_reference: Estimate
    """MSE over that of the reference model on the same part"""
    over_library: Estimate
    """MSE over that of the same model on the library"""

    @property
    def rms(self) -> Estimate:
        """Root of the MSE, in `unit`."""
        return Estimate(*np.sqrt(self.mse))

    def record(self) -> dict[str, Any]:
        """The row with one key for each number, for JSON."""
        return {
            **self._asdict(),
            **_keyed("mse", self.mse),
            "rms": float(self.rms.value),
            **_keyed("over_reference", self.over_reference),
            **_keyed("over_library", self.over_library),
        }


class _Errors(NamedTuple):
    """Of N trajectories."""

    mse: Array
    """(N, n) over the steps; infinite where a prediction is not finite"""
    diverged: NDArray[np.bool_]
    """(N,)"""

    def take(self, rows: NDArray[np.bool_]) -> "_Errors":
        return _Errors(self.mse[rows], self.diverged[rows])

    @property
    def n_diverged(self) -> int:
        return int(np.count_nonzero(self.diverged))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Errors of models and baselines on the same parts."""

    states: tuple[StateUnit, ...]
    dt_s: float
    models: tuple[str, ...]
    """names of the evaluated models; the first is the reference"""
    baselines: tuple[str, ...]
    linear: tuple[str, ...]
    """those of the baselines that are linear in states, past and inputs"""
    not_converged: tuple[str, ...]
    """baselines whose training ended before their validation error was flat"""
    parts: tuple[Part, ...]
    """the library first"""
    table: Mapping[tuple[str, str], tuple[Row, ...]]
    """rows by part and model; first the states, then their geometric means"""
    by_step: Mapping[str, Estimate]
    """by model: RMS error (K, n) of each step on the library"""

    @property
    def names(self) -> tuple[str, ...]:
        """All models, then all baselines."""
        return self.models + self.baselines

    @property
    def reference(self) -> str:
        """The model that the errors of the others are divided by."""
        return self.names[0]

    @property
    def library(self) -> dict[str, tuple[Row, ...]]:
        """The rows of the library by model, also of `FAIR_LTI`."""
        return {
            model: rows for (part, model), rows in self.table.items() if part == self.parts[0].name
        }

    def best_linear(self, part: str) -> str | None:
        """The linear baseline with the smallest geometric mean of its errors, if there is one."""

        def mean(name: str) -> float:
            rows = self.table[part, name][: len(self.states)]
            return float(geometric_mean(np.array([row.mse.value for row in rows])))

        return min(self.linear, key=mean, default=None)

    def figures(self) -> dict[str, Any]:
        """All results, for JSON."""
        return {
            "models": list(self.models),
            "baselines": list(self.baselines),
            "linear_baselines": list(self.linear),
            "not_converged": list(self.not_converged),
            "reference": self.reference,
            "dt_s": self.dt_s,
            "bootstrap": {
                "by": "episode",
                "resamples": RESAMPLES,
                "confidence": CONFIDENCE,
                "seed": SEED,
            },
            "parts": [
                {
                    "part": part.name,
                    "description": part.description,
                    "data_sha256": part.test.data_sha256,
                    "trajectories": part.n_trajectories,
                    "episodes": part.n_episodes,
                    "best_linear": self.best_linear(part.name),
                }
                for part in self.parts
            ],
            "rows": [row.record() for rows in self.table.values() for row in rows],
            "by_step": [
                {"model": name, "state": state.name, "unit": state.unit}
                | _keyed("rms", Estimate(*(each[:, i].tolist() for each in found)))
                for name, found in self.by_step.items()
                for i, state in enumerate(self.states)
            ],
        }


def compare_models(
    models: Mapping[str, Predictor],
    baselines: Mapping[str, Predictor],
    parts: Sequence[Part],
    schema: Schema,
    *,
    linear: Collection[str] = (),
    not_converged: Collection[str] = (),
    on_progress: Callable[[str, str], None] = lambda model, test: None,
) -> Comparison:
    """Every model and baseline evaluated on every part.

    Args:
        models: the evaluated models by name, the reference first.
        baselines: what they are compared with.
        parts: of test sets, the whole library first.
        schema: of their signals.
        linear, not_converged: as in `Comparison`.
        on_progress: called with the name of the model and of the set before each evaluation.
    """
    states, library = state_units(schema), parts[0].test
    predictors = {**models, **baselines}
    errors: dict[str, dict[str, _Errors]] = {part.test.name: {} for part in parts}
    by_step: dict[str, Estimate] = {}
    for test in {part.test.name: part.test for part in parts}.values():
        for name, model in predictors.items():
            on_progress(name, test.name)
            magnitude = absolute_errors(model, test, states)
            with np.errstate(over="ignore"):
                squared = np.square(magnitude)
                mse = squared.mean(axis=1)
                if test is library:
                    draws = mean_draws(squared, test.trajectories.episode)
                    by_step[name] = estimate(np.sqrt(draws))
            is_finite = np.isfinite(magnitude).all(axis=(1, 2))
            errors[test.name][name] = _Errors(mse, ~is_finite)
    fair = (FAIR_LTI,) if set(LTI_BASELINES) <= set(baselines) else ()
    table: dict[tuple[str, str], tuple[Row, ...]] = {}
    of_library: dict[str, Array] = {}
    for part in parts:
        of_part = {name: each.take(part.rows) for name, each in errors[part.test.name].items()}
        episode = part.test.trajectories.episode[part.rows]
        draws_of = {name: mean_draws(each.mse, episode) for name, each in of_part.items()}
        if fair:
            draws_of[FAIR_LTI] = np.min([draws_of[name] for name in LTI_BASELINES], axis=0)
        of_library = of_library or draws_of
        for name in (*models, *fair, *baselines):
            draws = draws_of[name]
            over_reference = ratios_of(draws, draws_of[next(iter(predictors))], states)
            over_library = ratios_of(draws, of_library[name], states)
            diverged = of_part[name].n_diverged if name in of_part else 0
            table[part.name, name] = _rows(
                part, name, states, diverged, estimate(draws), over_reference, over_library
            )
    return Comparison(
        states,
        schema.dt_s,
        tuple(models),
        tuple(baselines),
        tuple(linear),
        tuple(not_converged),
        tuple(parts),
        table,
        by_step,
    )


def _rows(
    part: Part,
    model: str,
    states: Sequence[StateUnit],
    diverged: int,
    mse: Estimate,
    over_reference: Estimate,
    over_library: Estimate,
) -> tuple[Row, ...]:
    """The rows of one model on one part, from estimates (n,) and two (n + means,)."""
    means = mean_names(states)
    keys = [*((state.name, state.unit) for state in states), *((name, "") for name in means)]
    no_value = [Estimate(*[np.nan] * 3)] * len(means)
    columns = zip([*_each(mse), *no_value], _each(over_reference), _each(over_library), strict=True)
    return tuple(
        Row(part.name, model, *key, part.n_trajectories, diverged, *numbers)
        for key, numbers in zip(keys, columns, strict=True)
    )


def _each(found: Estimate) -> list[Estimate]:
    """The entries of an estimate (n,)."""
    return [Estimate(*numbers) for numbers in np.transpose(found).tolist()]


def _keyed(name: str, found: Estimate) -> dict[str, Any]:
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
