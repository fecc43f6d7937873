"""The rival of everyday tracking: what changed lately goes on changing as it did.

The slope of each remembered state over the last periods is kept for the whole horizon. On the car
these are speeds and yaw rate, and the path follows from them exactly; a state that no past is kept
of stays as it is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.baselines.finding import Finding
from offline.baselines.road_path import path_states
from offline.baselines.score import log_error, tuning_windows
from offline.baselines.window_shape import WindowShape
from offline.dataset import Dataset
from offline.lengths import PAST_STEPS
from offline.roles import past_columns
from rt_controller.contract.schema import VEHICLE

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ConstantAcceleration:
    """Straight lines through the last points."""

    columns: NDArray[np.int64]
    """(h_x,) states that the past holds, in its order"""
    remembered: int
    """signals in a row of the past"""
    past_steps: int
    """rows a line is laid through, beside the first state"""
    lasts_s: float
    """for so long do slopes last, fading exponentially; infinite: for ever"""
    knows_road: bool
    """whether the path is that of the car on its road"""
    dt_s: float

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n).

        Raises:
            DatasetError: the shapes do not fit.
        """
        shape = WindowShape(
            x0.shape[-1], U.shape[-1], W.shape[-1], self.remembered, self.past_steps
        )
        shape.require(x0, past, U, W)
        steps = np.arange(U.shape[1] + 1)
        states = np.repeat(x0[:, None], len(steps), axis=1)
        measured = past[:, past.shape[1] - self.past_steps :, : len(self.columns)]
        measured = np.concatenate([measured, x0[:, None, self.columns]], axis=1)
        slope = _slope(measured)
        per_step = np.exp(-self.dt_s / self.lasts_s)
        run = steps if np.isinf(self.lasts_s) else (1.0 - per_step**steps) / (1.0 - per_step)
        states[:, :, self.columns] += slope[:, None] * run[:, None]
        if self.knows_road:
            path = path_states(np, states[:, :, :3], x0, W[:, :, 0], self.dt_s)
            states[:, 1:, 3:] = path
        return states

    def findings(self) -> tuple[Finding, ...]:
        """How much of the past is looked at, and how long its slope lasts."""
        return (
            Finding("past periods", str(self.past_steps)),
            Finding("slopes last, in s", f"{self.lasts_s:g}"),
        )


@dataclass(frozen=True, slots=True)
class AccelerationSettings:
    """What is tried on the validation part."""

    past_steps: tuple[int, ...] = (1, 2, 4, 8, PAST_STEPS)
    lasts_s: tuple[float, ...] = (np.inf, 2.0, 1.0, 0.5, 0.25, 0.1, 0.05)


def fit_acceleration(
    dataset: Dataset, settings: AccelerationSettings = AccelerationSettings()
) -> ConstantAcceleration:
    """The best of the settings on the validation part."""
    columns, inputs = past_columns(dataset.schema, dataset.roles)
    validation = tuning_windows(dataset)
    tried = [
        ConstantAcceleration(
            columns=np.array(columns, dtype=np.int64),
            remembered=len(columns) + len(inputs),
            past_steps=past_steps,
            lasts_s=lasts_s,
            knows_road=dataset.schema == VEHICLE,
            dt_s=dataset.schema.dt_s,
        )
        for past_steps in settings.past_steps
        for lasts_s in settings.lasts_s
    ]
    return min(tried, key=lambda rival: log_error(rival, validation))


def _slope(measured: Array) -> Array:
    """(batch, h) slope per step of the least-squares line through (batch, T, h)."""
    time = np.arange(measured.shape[1]) - 0.5 * (measured.shape[1] - 1)
    return np.asarray(np.tensordot(time, measured, (0, 1)) / np.square(time).sum())
