"""A linear model of the change of the states over a step, with a past, blended over speed.

With v_k the scaled speed, a past of H rows and J knots of speed,

    z_k = [x_k; past states of the H rows before; past inputs of these rows; u_k; w_k; 1],
    x_(k+1) = x_k + sum_j phi_j(v_k) theta_j z_k,

where the phi_j are hat functions over the knots, constant beyond them, whose sum is 1. One knot
makes the model linear and time-invariant. For a car on a road x are v_x, v_y and yaw rate, w has no
curvature, and progress, e_y and e_psi follow by `offline.baselines.road_path`.

The fit is a ridge regression of single steps; past, knots, ridge and which speed is followed are
those with the smallest log error on the validation part.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from offline.baselines.baseline import require_windows
from offline.baselines.fitting import (
    MOST_TRANSITIONS,
    RIDGES,
    Transitions,
    best_model,
    moments,
    pick_transitions,
    ridge_solution,
)
from offline.baselines.road_path import Learned, path_states, split_path
from offline.data.dataset import Dataset
from offline.data.signals import Roles, Scaling, fit_scaling, past_columns
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema
from rt_controller.model.follow import Follow
from rt_controller.report.table import Fact


@dataclass(frozen=True, slots=True)
class ScheduledSettings:
    """The values that are tried, in all combinations."""

    past_steps: tuple[int, ...] = (0,)
    knots: tuple[int, ...] = (1,)
    """number of knots; the first and the last are the 1 % and 99 % quantiles of the speed"""
    ridges: tuple[float, ...] = RIDGES
    follows: tuple[Follow, ...] = (Follow.PREDICTION, Follow.START)
    """without effect on a model of one knot"""


class Structure(NamedTuple):
    """Which signals a model reads and predicts, and how it is blended."""

    schema: Schema
    roles: Roles
    scaling: Scaling
    learned: Learned
    past_steps: int = 0
    """H"""
    knots: Array = np.zeros(1)
    """(J,) ascending, of the scaled speed"""
    follows: Follow = Follow.PREDICTION
    """v_k is the predicted speed, or with `Follow.START` the first one in all steps"""

    @property
    def speed(self) -> int:
        """Column of the state that the model is blended over: the first centred one."""
        return self.schema.state_names.index(self.roles.centred[0]) if self.roles.centred else 0

    @property
    def past_states(self) -> list[int]:
        """Columns of the states in a row of the past."""
        return past_columns(self.schema, self.roles)[0]

    @property
    def state_regressors(self) -> int:
        """Number of the regressors in z that are states; they come first."""
        return self.learned.states + self.past_steps * len(self.past_states)


@dataclass(frozen=True, slots=True)
class ScheduledModel:
    """A fitted linear model; see the top of this module."""

    structure: Structure
    theta: Array
    """(J, learned, r)"""
    ridge: float
    """that the fit was made with"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`."""
        structure, scaling = self.structure, self.structure.scaling
        signals = (len(scaling.x_scale), len(scaling.u_scale), len(scaling.w_scale))
        past_signals = len(scaling.past_scale) if structure.past_steps else 0
        require_windows(x0, past, U, W, signals, past_signals, structure.past_steps)
        with np.errstate(over="ignore", invalid="ignore"):
            states = _roll_out(self, x0, past, U, W)
            if (curvature := structure.learned.curvature) is not None:
                dt_s = structure.schema.dt_s
                path = path_states(np, states, x0, W[..., curvature], dt_s)
                states = np.concatenate([states[:, 1:], path], 2)
            else:
                states = states[:, 1:]
        return np.concatenate([x0[:, None], states], axis=1)

    def fit_info(self) -> tuple[Fact, ...]:
        """Past, knots, and how it was fitted."""
        structure = self.structure
        speed = structure.speed
        name = structure.schema.state_names[speed]
        physical = structure.knots * structure.scaling.x_scale[speed]
        knots = ", ".join(f"{v:.3g}" for v in physical + structure.scaling.x_centre[speed])
        is_blended = len(structure.knots) > 1
        return (
            Fact("past periods", str(structure.past_steps)),
            Fact(f"knots of {name}", knots if is_blended else "none"),
            Fact("speed in a prediction", str(structure.follows) if is_blended else "not used"),
            Fact("path", "learned" if structure.learned.curvature is None else "integrated"),
            Fact("ridge of the one-step fit", f"{self.ridge:g}"),
        )


def hat_functions(speed: Array, knots: Array) -> Array:
    """phi (batch, J) of the scaled speed (batch,)."""
    shares = np.clip((speed[:, None] - knots[:-1]) / (knots[1:] - knots[:-1]), 0.0, 1.0)
    one, none = np.ones_like(speed)[:, None], np.zeros_like(speed)[:, None]
    return np.asarray(np.concatenate([one, shares], 1) - np.concatenate([shares, none], 1))


def fit_scheduled(dataset: Dataset, settings: ScheduledSettings) -> ScheduledModel:
    """The model with the smallest validation score of all that the settings allow.

    Raises:
        DatasetError: no model predicts finite numbers.
    """
    return best_model(_models(dataset, settings), dataset)


def _roll_out(model: ScheduledModel, x0: Array, past: Array, U: Array, W: Array) -> Array:
    """Learned states (batch, K+1, learned) in physical units."""
    structure, theta = model.structure, model.theta
    scaling, n, knots = structure.scaling, structure.learned.states, structure.knots
    before, driven_by = _regressors(structure, past, U, W)
    J, split = len(knots), structure.state_regressors
    x = ((x0 - scaling.x_centre) / scaling.x_scale)[:, :n]
    of_states = theta[..., :split].reshape(J * n, split).T
    driven = driven_by @ theta[..., split:].reshape(J * n, -1).T
    oldest = len(structure.past_states)
    phi = hat_functions(x[:, structure.speed], knots)
    motion = [x]
    for k, forcing in enumerate(np.swapaxes(driven, 0, 1)):
        if k and structure.follows is Follow.PREDICTION and J > 1:
            phi = hat_functions(x[:, structure.speed], knots)
        z = np.concatenate([x, before], 1)
        changes = (z @ of_states + forcing).reshape(len(x), J, n)
        if structure.past_steps:
            before = np.concatenate([before[:, oldest:], x[:, structure.past_states]], 1)
        x = x + (phi[:, :, None] * changes).sum(1)
        motion.append(x)
    return np.asarray(np.stack(motion, 1) * scaling.x_scale[:n] + scaling.x_centre[:n])


def _regressors(structure: Structure, past: Array, U: Array, W: Array) -> tuple[Array, Array]:
    """Scaled past states (batch, H * s), and past inputs, u, w and 1 (batch, K, d) of each step."""
    scaling, H = structure.scaling, structure.past_steps
    batch, steps = U.shape[:2]
    u, w = U / scaling.u_scale, W / scaling.w_scale
    rows = (past[:, past.shape[1] - H :] - scaling.past_centre) / scaling.past_scale
    _, past_inputs = past_columns(structure.schema, structure.roles)
    states = len(structure.past_states)
    inputs = np.concatenate([rows[..., states:], u[..., past_inputs]], axis=1)
    before = [inputs[:, i : i + steps] for i in range(H)]
    others = [u, w[..., structure.learned.exogenous], np.ones((batch, steps, 1))]
    return rows[..., :states].reshape(batch, -1), np.concatenate([*before, *others], axis=-1)


def _models(dataset: Dataset, settings: ScheduledSettings) -> Iterator[ScheduledModel]:
    """One for each past, number of knots, ridge, and way to follow the speed.

    There is one knot if no state is centred or the speed is constant.
    """
    train, schema, roles = dataset.select("train"), dataset.schema, dataset.roles
    scaling, learned = fit_scaling(train, schema, roles), split_path(schema)
    for past_steps in settings.past_steps:
        data = pick_transitions(train, schema, roles, past_steps, MOST_TRANSITIONS)
        structure = Structure(schema, roles, scaling, learned, past_steps)
        speed = scaling.normalise_states(train.x[:, 0])[:, structure.speed]
        first, last = np.quantile(speed, (0.01, 0.99))
        for J in settings.knots if roles.centred and first < last else (1,):
            structure = structure._replace(knots=np.linspace(first, last, J))
            of = moments(data, partial(_regression, structure))
            follows = settings.follows if J > 1 else settings.follows[:1]
            for ridge in settings.ridges:
                operator = ridge_solution(of, ridge).reshape(learned.states, J, -1)
                theta = np.ascontiguousarray(operator.swapaxes(0, 1))
                for each in follows:
                    yield ScheduledModel(structure._replace(follows=each), theta, ridge)


def _regression(structure: Structure, data: Transitions) -> tuple[Array, Array]:
    """phi_j z (M, J * r) of M single steps, and the change of the learned states (M, n)."""
    x = structure.scaling.normalise_states(data.x)[..., : structure.learned.states]
    past, driven = _regressors(structure, data.past[:, 0], data.u[:, None], data.w[:, None])
    z = np.concatenate([x[:, 0], past, driven[:, 0]], axis=1)
    phi = hat_functions(x[:, 0, structure.speed], structure.knots)
    return (phi[:, :, None] * z[:, None]).reshape(len(z), -1), x[:, 1] - x[:, 0]
