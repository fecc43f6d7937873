"""Constant acceleration: the recent slopes of speeds and yaw rate continue.

The slope of each state in the past is kept over the horizon, or fades exponentially. For the car
these are speeds and yaw rate, and the path follows from them by kinematics; a state that is not in
the past keeps its value.
"""

from dataclasses import dataclass

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.road_path import path_states, split_path
from offline.baselines.score import log_error, tuning_windows
from offline.baselines.window_shape import require_windows
from offline.config import PAST_STEPS
from offline.data.dataset import Dataset
from offline.data.signals import Roles, last_rows, past_columns
from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import Schema
from rt_controller.contract.signals import MOTION, PATH_STATES
from rt_controller.report.table import Fact

TRIED_PAST_STEPS = (1, 2, 4, 8, PAST_STEPS)
TRIED_DECAY_S = (np.inf, 2.0, 1.0, 0.5, 0.25, 0.1, 0.05)


@dataclass(frozen=True, slots=True)
class ConstantAcceleration:
    """Straight or exponentially fading lines through the last points."""

    schema: Schema
    roles: Roles
    past_steps: int
    """rows of the past that a line is fitted to, together with the first state"""
    decay_s: float
    """time constant of the slopes; infinite: constant slopes"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`."""
        columns, inputs = past_columns(self.schema, self.roles)
        signals = (x0.shape[-1], U.shape[-1], W.shape[-1])
        require_windows(x0, past, U, W, signals, len(columns) + len(inputs), self.past_steps)
        steps = np.arange(U.shape[1] + 1)
        states = np.repeat(x0[:, None], len(steps), axis=1)
        measured = last_rows(past, self.past_steps)[..., : len(columns)]
        measured = np.concatenate([measured, x0[:, None, columns]], axis=1)
        decay = np.exp(-self.schema.dt_s / self.decay_s)
        factor = steps if np.isinf(self.decay_s) else (1.0 - decay**steps) / (1.0 - decay)
        # the slope per step (batch, h) of the least-squares line through (batch, T, h)
        time = np.arange(measured.shape[1]) - 0.5 * (measured.shape[1] - 1)
        slope = np.tensordot(time, measured, (0, 1)) / np.square(time).sum()
        states[:, :, columns] += slope[:, None] * factor[:, None]
        curvature = split_path(self.schema).curvature
        if curvature is not None:
            motion, kappa = states[:, :, MOTION], W[:, :, curvature]
            states[:, 1:, PATH_STATES] = path_states(np, motion, x0, kappa, self.schema.dt_s)
        return states

    def fit_info(self) -> tuple[Fact, ...]:
        """The chosen past and time constant."""
        return (
            Fact("past periods", str(self.past_steps)),
            Fact("time constant of slopes in s", f"{self.decay_s:g}"),
        )


def fit_acceleration(dataset: Dataset) -> ConstantAcceleration:
    """The settings with the smallest log error on the validation part."""
    validation = tuning_windows(dataset)
    tried = [
        ConstantAcceleration(dataset.schema, dataset.roles, past_steps, decay_s)
        for past_steps in TRIED_PAST_STEPS
        for decay_s in TRIED_DECAY_S
    ]
    return min(tried, key=lambda baseline: log_error(baseline, validation))


BASELINE = Baseline(fit=fit_acceleration)
