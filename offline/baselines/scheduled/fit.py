"""One-step ridge regression of the blended linear model, and the choice of its settings.

As for dictionaries (`offline.baselines.dictionary.fit`), sums of products are accumulated chunk by
chunk, once for each past and set of knots, and the settings with the smallest log error on the
validation part are kept.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.dictionary.fit import Transitions, pick_transitions, ridge_solution
from offline.baselines.road_path import learn_all, split_path
from offline.baselines.scheduled.model import ScheduledModel, Structure, series_of, weights
from offline.baselines.score import log_error, tuning_windows
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, fit_scaling
from offline.data.trajectories import Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.model.follow import Follow

_CHUNK = 10_000


@dataclass(frozen=True, slots=True)
class LinearSettings:
    """The values that are tried, in all combinations."""

    past_steps: tuple[int, ...] = (0,)
    knots: tuple[int, ...] = (1,)
    """number of knots; the first and the last are the 1 % and 99 % quantiles of the speed"""
    ridges: tuple[float, ...] = (1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3)
    follows: tuple[Follow, ...] = (Follow.PREDICTION, Follow.START)
    """without effect on a model of one knot"""
    has_exact_path: bool = True
    """for a car on a road; other data have no path"""
    most_transitions: int = 250_000


def linear(settings: LinearSettings) -> Baseline:
    """The baseline with these settings."""
    return Baseline(fit=partial(fit_linear_models, settings=settings), model_class="linear")


def fit_linear_models(dataset: Dataset, settings: LinearSettings) -> ScheduledModel:
    """The model with the smallest validation score of all that the settings allow.

    Raises:
        DatasetError: no model predicts finite numbers.
    """
    train, validation = dataset.select("train"), tuning_windows(dataset)
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    best_score, best = np.inf, None
    for past_steps in settings.past_steps:
        data = pick_transitions(
            train, dataset.schema, dataset.roles, past_steps, settings.most_transitions
        )
        for structure in _structures(settings, dataset, train, scaling, past_steps):
            for model in _models(structure, data, settings):
                score = log_error(model, validation)
                if score < best_score:
                    best_score, best = score, model
    if best is None:
        raise DatasetError(
            "expected a linear model that predicts finite numbers over the validation part, found "
            "none. Leave out this baseline, or widen its ridges."
        )
    return best


def _structures(
    settings: LinearSettings,
    dataset: Dataset,
    train: Trajectories,
    scaling: Scaling,
    past_steps: int,
) -> Iterator[Structure]:
    """One for each number of knots; one knot if no state is centred or the speed is constant."""
    schema, roles = dataset.schema, dataset.roles
    learned = split_path(schema) if settings.has_exact_path else learn_all(schema)
    structure = Structure(schema, roles, scaling, learned, past_steps)
    speed = scaling.normalise_states(train.x[:, 0])[:, structure.speed]
    first, last = np.quantile(speed, (0.01, 0.99))
    for count in settings.knots if roles.centred and first < last else (1,):
        yield structure._replace(knots=np.linspace(first, last, count))


def _models(
    structure: Structure, data: Transitions, settings: LinearSettings
) -> Iterator[ScheduledModel]:
    """One for each ridge and each way to follow the speed."""
    of = moments(structure, data)
    follows = settings.follows if len(structure.knots) > 1 else settings.follows[:1]
    for ridge in settings.ridges:
        theta = _by_knot(structure, ridge_solution(of, ridge))
        for each in follows:
            yield ScheduledModel(structure._replace(follows=each), theta, ridge)


def moments(structure: Structure, data: Transitions) -> tuple[Array, Array]:
    """Mean products over a step: (Jr, Jr) of the weighted regressors, (Jr, n) with the change."""
    count, n = len(data.u), structure.learned.states
    of_regressors: Array | float = 0.0
    of_targets: Array | float = 0.0
    for first in range(0, count, _CHUNK):
        part = slice(first, first + _CHUNK)
        x = structure.scaling.normalise_states(data.x[part])[..., :n]
        rows = weighted_regressors(
            structure, data.x[part, 0], data.past[part, 0], data.u[part], data.w[part]
        )
        of_regressors = of_regressors + rows.T @ rows / count
        of_targets = of_targets + rows.T @ (x[:, 1] - x[:, 0]) / count
    return np.asarray(of_regressors), np.asarray(of_targets)


def weighted_regressors(structure: Structure, x: Array, past: Array, u: Array, w: Array) -> Array:
    """phi_j z (M, J * r) of M single steps in physical units; past (M, H, h)."""
    series = series_of(structure, x, past, u[:, None], w[:, None])
    states = structure.scaling.normalise_states(x)[:, : structure.learned.states]
    z = np.concatenate([states, series.past, series.driven[:, 0]], axis=1)
    phi = weights(np, states[:, structure.speed], structure.knots)
    return np.asarray((phi[:, :, None] * z[:, None]).reshape(len(z), -1))


def _by_knot(structure: Structure, operator: Array) -> Array:
    """theta (J, n, r) of an operator (n, J * r)."""
    n, J = len(operator), len(structure.knots)
    return np.ascontiguousarray(operator.reshape(n, J, -1).swapaxes(0, 1))
