"""A linear model of the change of the states over a step, blended over speed.

With v_k the scaled speed, a past of H rows and J knots of speed,

    z_k = [x_k; past states of the H rows before; past inputs of these rows; u_k; w_k; 1],
    x_(k+1) = x_k + sum_j phi_j(v_k) theta_j z_k,

where the phi_j are hat functions over the knots, constant beyond them, whose sum is 1. One knot
makes the model linear and time-invariant. With the exact path of a car, x are v_x, v_y and yaw
rate, w has no curvature, and progress, e_y and e_psi follow by `offline.baselines.road_path`.
"""

from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from offline.baselines.road_path import Learned, path_states
from offline.baselines.window_shape import require_windows
from offline.data.signals import Roles, Scaling, past_columns
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.schema import Schema
from rt_controller.report.table import Fact


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


class Series(NamedTuple):
    """Scaled windows as the roll-out needs them; arrays or tensors."""

    x0: Any
    """(batch, n) first states in physical units"""
    past: Any
    """(batch, H * s) past states, oldest row first"""
    driven: Any
    """(batch, K, d) regressors that are not states: past inputs, u, w, 1"""
    kappa: Any
    """(batch, K) curvature in 1/m; (batch, 0) without an exact path"""


def series_of(structure: Structure, x0: Array, past: Array, U: Array, W: Array) -> Series:
    """The windows scaled; arguments as of `Predictor.predict`."""
    scaling, H = structure.scaling, structure.past_steps
    batch, steps = U.shape[:2]
    u, w = U / scaling.u_scale, W / scaling.w_scale
    rows = (past[:, past.shape[1] - H :] - scaling.past_centre) / scaling.past_scale
    _, past_inputs = past_columns(structure.schema, structure.roles)
    states = len(structure.past_states)
    inputs = np.concatenate([rows[..., states:], u[..., past_inputs]], axis=1)
    before = [inputs[:, i : i + steps] for i in range(H)]
    others = [u, w[..., structure.learned.exogenous], np.ones((batch, steps, 1))]
    curvature = structure.learned.curvature
    return Series(
        x0,
        rows[..., :states].reshape(batch, -1),
        np.concatenate([*before, *others], axis=-1),
        np.zeros((batch, 0)) if curvature is None else W[..., curvature],
    )


def weights(numerics: ModuleType, speed: Any, knots: Any) -> Any:
    """Hat functions (batch, J) of the scaled speed (batch,)."""
    shares = numerics.clip((speed[:, None] - knots[:-1]) / (knots[1:] - knots[:-1]), 0.0, 1.0)
    one, none = numerics.ones_like(speed)[:, None], numerics.zeros_like(speed)[:, None]
    return numerics.concatenate([one, shares], 1) - numerics.concatenate([shares, none], 1)


def roll_out(
    numerics: ModuleType, structure: Structure, theta: Any, knots: Any, series: Series
) -> Any:
    """States (batch, K, n) of steps 1..K in physical units; theta (J, learned, r).

    All are arrays or tensors of the library `numerics`: numpy or torch.
    """
    scaling, n = structure.scaling, structure.learned.states
    centre, scale = (_like(numerics, each) for each in (scaling.x_centre, scaling.x_scale))
    J, split = len(knots), structure.state_regressors
    x = ((series.x0 - centre) / scale)[:, :n]
    of_states = theta[..., :split].reshape(J * n, split).T
    driven = series.driven @ theta[..., split:].reshape(J * n, -1).T
    past, oldest = series.past, len(structure.past_states)
    phi = weights(numerics, x[:, structure.speed], knots)
    motion = [x]
    # Iterating over the first axis is one operation for the gradient, indexing one for each step.
    for k, forcing in enumerate(numerics.swapaxes(driven, 0, 1)):
        if k and structure.follows is Follow.PREDICTION and J > 1:
            phi = weights(numerics, x[:, structure.speed], knots)
        z = numerics.concatenate([x, past], 1)
        each = (z @ of_states + forcing).reshape(len(x), J, n)
        if structure.past_steps:
            newest = x[:, structure.past_states]
            past = numerics.concatenate([past[:, oldest:], newest], 1)
        x = x + (phi[:, :, None] * each).sum(1)
        motion.append(x)
    states = numerics.stack(motion, 1) * scale[:n] + centre[:n]
    if structure.learned.curvature is None:
        return states[:, 1:]
    path = path_states(numerics, states, series.x0, series.kappa, structure.schema.dt_s)
    return numerics.concatenate([states[:, 1:], path], 2)


def _like(numerics: ModuleType, array: Array) -> Any:
    return array if numerics is np else numerics.from_numpy(array)


@dataclass(frozen=True, slots=True)
class ScheduledModel:
    """A fitted linear model; see the top of this module."""

    structure: Structure
    theta: Array
    """(J, learned, r)"""
    ridge: float
    """that the one-step fit was made with"""
    iterations: int = 0
    """of the descent on the error over the horizon"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`."""
        structure, scaling = self.structure, self.structure.scaling
        signals = (len(scaling.x_scale), len(scaling.u_scale), len(scaling.w_scale))
        past_signals = len(scaling.past_scale) if structure.past_steps else 0
        require_windows(x0, past, U, W, signals, past_signals, structure.past_steps)
        series = series_of(structure, x0, past, U, W)
        with np.errstate(over="ignore", invalid="ignore"):
            states = roll_out(np, structure, self.theta, structure.knots, series)
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
            Fact("iterations on the horizon", str(self.iterations)),
        )
