"""A network as a baseline: scaled signals, and the path of a car by kinematics.

For a car on a road v_x, v_y and yaw rate are learned and the path follows from them; of other data
all states are learned. The networks are neither linear in the inputs nor convex to plan with.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from offline.baselines.recurrent.network import Gated, StateSpace
from offline.baselines.road_path import Learned, path_states
from offline.baselines.window_shape import require_windows
from offline.data.sampling import Batch
from offline.data.signals import Scaling, last_rows
from rt_controller.contract.arrays import Array
from rt_controller.report.table import Fact

_BATCH = 2_000
"""windows predicted at once"""


class Training(NamedTuple):
    """How a network was trained."""

    steps: int
    is_flat: bool
    """True if the training ended because the validation error did, False at the limit of steps"""
    curve: tuple[tuple[int, float], ...]
    """steps, and the log error on the validation part after them"""


@dataclass(frozen=True, slots=True)
class RecurrentModel:
    """The network, and the scales of the signals."""

    network: Gated | StateSpace
    past_steps: int
    learned: Learned
    scaling: Scaling
    dt_s: float
    training: Training | None = None

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`."""
        scaling = self.scaling
        signals = (len(scaling.x_scale), len(scaling.u_scale), len(scaling.w_scale))
        require_windows(x0, past, U, W, signals, len(scaling.past_scale), self.past_steps)
        states = np.empty((len(x0), U.shape[1] + 1, len(scaling.x_scale)))
        states[:, 0] = x0
        for first in range(0, len(x0), _BATCH):
            rows = slice(first, first + _BATCH)
            last = last_rows(past[rows], self.past_steps)
            with torch.no_grad():
                predicted = self.predict_scaled(
                    _tensor(scaling.normalise_states(x0[rows])),
                    _tensor((last - scaling.past_centre) / scaling.past_scale),
                    _tensor(U[rows] / scaling.u_scale).transpose(0, 1),
                    _tensor(W[rows] / scaling.w_scale).transpose(0, 1),
                )
            scaled = predicted.transpose(0, 1).double().numpy()
            states[rows, 1:] = scaled * scaling.x_scale + scaling.x_centre
        return states

    def predict_scaled(self, x0: Tensor, past: Tensor, u: Tensor, w: Tensor) -> Tensor:
        """Scaled states (K, batch, n) of steps 1..K; arguments scaled, `u` and `w` time first."""
        n, exogenous, curvature = self.learned
        acting = w[..., list(exogenous)]
        seen = torch.cat([x0[:, :n], past.flatten(1), acting[0]], dim=1)
        states: Tensor = self.network(x0[:, :n], seen, torch.cat([u, acting], dim=-1))
        if curvature is None:
            return states
        centre, scale = _tensor(self.scaling.x_centre), _tensor(self.scaling.x_scale)
        motion = torch.cat([x0[None, :, :n], states]) * scale[:n] + centre[:n]
        kappa = w[..., curvature] * float(self.scaling.w_scale[curvature])
        path = path_states(
            torch, motion.transpose(0, 1), x0 * scale + centre, kappa.transpose(0, 1), self.dt_s
        )
        path = (path - centre[n:]) / scale[n:]
        return torch.cat([states, path.transpose(0, 1)], dim=-1)

    def errors(self, batch: Batch) -> Tensor:
        """(n,) mean squared errors of the scaled states over the horizon."""
        past = batch.memory[: self.past_steps].transpose(0, 1)
        return batch.errors_of(self.predict_scaled(batch.x[0], past, batch.u, batch.w))

    def fit_info(self) -> tuple[Fact, ...]:
        """Size of the network, how the path is made, and the course of the training."""
        facts = (
            Fact("parameters", str(sum(each.numel() for each in self.network.parameters()))),
            Fact("past periods", str(self.past_steps)),
            Fact("path", "learned" if self.learned.curvature is None else "integrated"),
        )
        if self.training is None:
            return facts
        steps, is_flat, curve = self.training
        course = ", ".join(f"{score:.3f} after {step}" for step, score in curve)
        return (
            *facts,
            Fact("training steps", str(steps)),
            Fact("end of the training", "validation error is flat" if is_flat else "step limit"),
            Fact("validation log error", course),
        )


def _tensor(array: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))
