"""Models compared with baselines: one long table of errors, a row a part, model and state.

`--json` writes the table; the tables of the terminal, the model card, the page and the documents
are views of it.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, SEED, Estimate, estimate, mean_draws
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
    """Error of one model in one state on one part; low and high are the ends of an interval."""

    part: str
    model: str
    state: str
    """without its unit, or a name of `mean_names`, which has ratios only"""
    unit: str
    trajectories: int
    diverged: int
    """trajectories with a prediction that is not finite"""
    mse: float
    """in the square of `unit`, over all steps and trajectories. Paper: Table II"""
    mse_low: float
    mse_high: float
    rms: float
    """in `unit`, the root of `mse`"""
    over_reference: float
    """MSE over that of the reference model on the same part"""
    over_reference_low: float
    over_reference_high: float
    over_library: float
    """MSE over that of the same model on the library"""
    over_library_low: float
    over_library_high: float


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
        """All models, then all baselines; the first is the reference."""
        return self.models + self.baselines

    @property
    def library(self) -> dict[str, tuple[Row, ...]]:
        """The rows of the library by model, also of `FAIR_LTI`."""
        library = self.parts[0].name
        return {model: rows for (part, model), rows in self.table.items() if part == library}

    def best_linear(self, part: str) -> str | None:
        """The linear baseline with the smallest geometric mean of its errors, if there is one."""

        def mean(name: str) -> float:
            rows = self.table[part, name][: len(self.states)]
            return float(geometric_mean(np.array([row.mse for row in rows])))

        return min(self.linear, key=mean, default=None)

    def figures(self) -> dict[str, Any]:
        """All results, for JSON."""
        return {
            "models": list(self.models),
            "baselines": list(self.baselines),
            "linear_baselines": list(self.linear),
            "not_converged": list(self.not_converged),
            "reference": self.names[0],
            "dt_s": self.dt_s,
            "bootstrap": {"resamples": RESAMPLES, "confidence": CONFIDENCE, "seed": SEED},
            "parts": [
                {
                    "part": part.name,
                    "is_whole_set": part.is_whole,
                    "description": part.description,
                    "data_sha256": part.test.data_sha256,
                    "trajectories": part.n_trajectories,
                    "episodes": part.n_episodes,
                    "best_linear": self.best_linear(part.name),
                }
                for part in self.parts
            ],
            "rows": [row._asdict() for rows in self.table.values() for row in rows],
            "by_step": [
                {"model": name, "state": state.name, "unit": state.unit}
                | {f"rms_{key}": values[:, i].tolist() for key, values in found._asdict().items()}
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
    states, predictors = state_units(schema), {**models, **baselines}
    mse: dict[tuple[str, str], Array] = {}
    diverged: dict[tuple[str, str], NDArray[np.bool_]] = {}
    by_step = {}
    for test in {part.test.name: part.test for part in parts}.values():
        for name, model in predictors.items():
            on_progress(name, test.name)
            errors = absolute_errors(model, test, states)
            diverged[test.name, name] = np.asarray(~np.isfinite(errors).all(axis=(1, 2)))
            with np.errstate(over="ignore"):
                squared = np.square(errors)
                mse[test.name, name] = squared.mean(axis=1)
            if test is parts[0].test:
                draws_by_step = mean_draws(squared, test.trajectories.episode)
                by_step[name] = estimate(np.sqrt(draws_by_step))

    fair = (FAIR_LTI,) if set(LTI_BASELINES) <= set(baselines) else ()
    names = (*models, *fair, *baselines)
    table: dict[tuple[str, str], tuple[Row, ...]] = {}
    library: dict[str, Array] = {}
    for part in parts:
        of_set, rows = part.test.name, part.rows
        episode = part.test.trajectories.episode[rows]
        draws = {name: mean_draws(mse[of_set, name][rows], episode) for name in predictors}
        if fair:
            draws[FAIR_LTI] = np.min([draws[name] for name in LTI_BASELINES], axis=0)
        library = library or draws
        for name in names:
            count = 0 if name == FAIR_LTI else int(diverged[of_set, name][rows].sum())
            over_reference = ratios_of(draws[name], draws[names[0]], states)
            over_library = ratios_of(draws[name], library[name], states)
            found = estimate(draws[name]), over_reference, over_library
            table[part.name, name] = _rows(part, name, count, states, *found)
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
    diverged: int,
    states: Sequence[StateUnit],
    mse: Estimate,
    over_reference: Estimate,
    over_library: Estimate,
) -> tuple[Row, ...]:
    """The rows of one model on one part, from estimates (n,) and two (n + means,)."""
    means = mean_names(states)
    keys = [*((state.name, state.unit) for state in states), *((name, "") for name in means)]
    errors = np.pad(np.array([*mse, np.sqrt(mse.value)]), ((0, 0), (0, len(means))),
                    constant_values=np.nan)  # fmt: skip
    numbers = np.vstack([errors, *over_reference, *over_library]).T.tolist()
    return tuple(
        Row(part.name, model, *key, part.n_trajectories, diverged, *of_state)
        for key, of_state in zip(keys, numbers, strict=True)
    )
