"""A linear model of the change of the states over a step, with a past, blended over speed.

With v_k the scaled speed, a past of H rows and J knots of speed,

    z_k = [x_k; past states of the H rows before; past inputs of these rows; u_k; w_k; 1],
    x_(k+1) = x_k + sum_j phi_j(v_k) theta_j z_k,

where the phi_j are hat functions over the knots, constant beyond them, whose sum is 1. One knot
makes the model linear and time-invariant. For a car on a road x are v_x, v_y and yaw rate, w has no
curvature, and progress, e_y and e_psi follow by `offline.baselines.road_path`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from offline.baselines.fitting import (
    RIDGES,
    Candidate,
    Transitions,
    fit_ridge,
    pick_transitions,
    scale_windows,
)
from offline.baselines.road_path import Learned, path_states, split_path
from offline.data.dataset import Dataset
from offline.data.signals import Roles, Scaling, fit_scaling, past_columns
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema
from rt_controller.model.follow import Follow


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

    def regressors(self, x: Array, rows: Array, u: Array, w: Array) -> Array:
        """z (batch, r) of scaled learned states, rows (batch, H, h) of the past, u and w."""
        batch, states = len(x), len(past_columns(self.schema, self.roles)[0])
        before = (rows[..., :states].reshape(batch, -1), rows[..., states:].reshape(batch, -1))
        w = w[:, self.learned.exogenous]
        return np.concatenate([x, *before, u, w, np.ones((batch, 1))], axis=1)


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
        structure, scaling, (J, n, r) = self.structure, self.structure.scaling, self.theta.shape
        x, u, w, rows = scale_windows(scaling, structure.past_steps, x0, past, U, W)
        x, theta = x[:, :n], self.theta.reshape(J * n, r).T
        past_states, past_inputs = past_columns(structure.schema, structure.roles)
        phi = hat_functions(x[:, structure.speed], structure.knots)
        motion = [x]
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(U.shape[1]):
                if structure.follows is Follow.PREDICTION:
                    phi = hat_functions(x[:, structure.speed], structure.knots)
                z = structure.regressors(x, rows, u[:, k], w[:, k])
                newest = np.concatenate([x[:, past_states], u[:, k, past_inputs]], axis=1)
                rows = np.concatenate([rows, newest[:, None]], axis=1)[:, 1:]
                x = x + (phi[:, :, None] * (z @ theta).reshape(len(x), J, n)).sum(axis=1)
                motion.append(x)
            states = np.stack(motion, 1) * scaling.x_scale[:n] + scaling.x_centre[:n]
            parts = [states[:, 1:]]
            if (kappa := structure.learned.curvature) is not None:
                parts.append(path_states(np, states, x0, W[..., kappa], structure.schema.dt_s))
        return np.concatenate([x0[:, None], np.concatenate(parts, axis=2)], axis=1)


def fit_scheduled(
    dataset: Dataset,
    past_steps: tuple[int, ...] = (0,),
    knots: tuple[int, ...] = (1,),
    ridges: tuple[float, ...] = RIDGES,
) -> ScheduledModel:
    """The model with the smallest validation score of all combinations of these settings.

    `knots` are numbers of knots; the first and the last knot are the 1 % and 99 % quantiles of the
    speed. There is one if no state is centred or the speed is constant.

    Raises:
        DatasetError: no model predicts finite numbers.
    """
    return fit_ridge(dataset, _candidates(dataset, past_steps, knots), ridges)


def hat_functions(speed: Array, knots: Array) -> Array:
    """phi (batch, J) of the scaled speed (batch,)."""
    shares = np.clip((speed[:, None] - knots[:-1]) / (knots[1:] - knots[:-1]), 0.0, 1.0)
    one, none = np.ones_like(speed)[:, None], np.zeros_like(speed)[:, None]
    return np.asarray(np.concatenate([one, shares], 1) - np.concatenate([shares, none], 1))


def _candidates(
    dataset: Dataset, past_steps: tuple[int, ...], knots: tuple[int, ...]
) -> Iterator[Candidate[ScheduledModel]]:
    train, schema, roles = dataset.select("train"), dataset.schema, dataset.roles
    scaling, learned = fit_scaling(train, schema, roles), split_path(schema)
    structure = Structure(schema, roles, scaling, learned)
    speed = scaling.normalise_states(train.x[:, 0])[:, structure.speed]
    first, last = np.quantile(speed, (0.01, 0.99))
    for H in past_steps:
        data = pick_transitions(train, dataset, scaling, H)
        for J in knots if roles.centred and first < last else (1,):
            candidate = structure._replace(past_steps=H, knots=np.linspace(first, last, J))
            yield Candidate(data, partial(_regression, candidate), partial(_models, candidate))


def _models(structure: Structure, operator: Array, ridge: float) -> Iterator[ScheduledModel]:
    """One for each way to follow the speed, of which a model of one knot has no use."""
    J = len(structure.knots)
    theta = operator.reshape(structure.learned.states, J, -1).swapaxes(0, 1)
    for follows in (Follow.PREDICTION, Follow.START)[: min(J, 2)]:
        theta = np.ascontiguousarray(theta)
        yield ScheduledModel(structure._replace(follows=follows), theta, ridge)


def _regression(structure: Structure, data: Transitions) -> tuple[Array, Array]:
    """phi_j z (M, J * r) of M single steps, and the change of the learned states (M, n)."""
    x = data.x[..., : structure.learned.states]
    z = structure.regressors(x[:, 0], data.past[:, 0], data.u, data.w)
    phi = hat_functions(x[:, 0, structure.speed], structure.knots)
    return (phi[:, :, None] * z[:, None]).reshape(len(z), -1), x[:, 1] - x[:, 0]
