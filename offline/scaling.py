"""Scaling between physical units and the numbers the network sees.

Fitted once, on the training trajectories only. A signal whose zero means something (straight
ahead, on the line, pedal released) is divided by its root mean square and never shifted, so that
left and right stay mirror images and a released pedal stays zero. Signals that are never near
zero, such as speed and progress, are centred too (`offline.roles`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.roles import Roles, past_columns
from offline.trajectories import Trajectories
from rt_controller.contract.schema import Schema

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Scaling:
    """Centre and spread of every signal, in physical units."""

    x_centre: Array
    """(n,) states"""
    x_scale: Array
    """(n,)"""
    u_scale: Array
    """(m,) inputs"""
    w_scale: Array
    """(p,) exogenous signals"""
    past_centre: Array
    """(h,) one row of history"""
    past_scale: Array
    """(h,)"""

    def normalise_states(self, x: NDArray[np.floating]) -> Array:
        """States (..., n) in units of their spread."""
        return np.asarray((x - self.x_centre) / self.x_scale, dtype=np.float64)


def fit_scaling(trajectories: Trajectories, schema: Schema, roles: Roles) -> Scaling:
    """Scaling of these trajectories; a signal that never moves keeps its unit: its scale is 1."""
    states = _rows(trajectories.x)
    is_centred = np.array([name in roles.centred for name in schema.state_names])
    x_centre = np.where(is_centred, states.mean(axis=0), 0.0)
    x_scale = _root_mean_square(states - x_centre)
    u_scale = _root_mean_square(_rows(trajectories.u))
    past_states, past_inputs = past_columns(schema, roles)
    return Scaling(
        x_centre=x_centre,
        x_scale=x_scale,
        u_scale=u_scale,
        w_scale=_root_mean_square(_rows(trajectories.w)),
        past_centre=np.concatenate([x_centre[past_states], np.zeros(len(past_inputs))]),
        past_scale=np.concatenate([x_scale[past_states], u_scale[past_inputs]]),
    )


def _rows(series: NDArray[np.floating]) -> Array:
    count = int(np.prod(series.shape[:-1]))
    return np.asarray(series, dtype=np.float64).reshape(count, series.shape[-1])


def _root_mean_square(rows: Array) -> Array:
    spread = np.sqrt(np.mean(np.square(rows), axis=0))
    return np.where(spread > 1e-12, spread, 1.0)
