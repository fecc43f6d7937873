"""Scaled trajectories as tensors, time first: what the loss functions see."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from offline.roles import Roles, past_columns
from offline.scaling import Scaling
from offline.trajectories import Trajectories
from rt_controller.contract.schema import Schema


class Instants(NamedTuple):
    """What the encoder may be shown of some instants; the last axis holds the signals."""

    x: Tensor
    """(..., n) states"""
    w: Tensor
    """(..., p) exogenous signals"""
    past: Tensor
    """(..., H, h) history, oldest row first"""


class Batch(NamedTuple):
    """A batch of K-step trajectories in units of their spread."""

    x: Tensor
    """(K+1, batch, n)"""
    u: Tensor
    """(K, batch, m)"""
    w: Tensor
    """(K, batch, p)"""
    memory: Tensor
    """(H+K, batch, h) rows of history from H steps before the start to the end"""

    @property
    def steps(self) -> int:
        return len(self.u)

    def shorten(self, steps: int) -> "Batch":
        """The first `steps` steps of every trajectory."""
        past = len(self.memory) - len(self.u)
        return Batch(
            self.x[: steps + 1], self.u[:steps], self.w[:steps], self.memory[: past + steps]
        )

    def at(self, times: Tensor) -> Instants:
        """The instants (M,) in 0..K; what is exogenous holds on to the last step's value."""
        past = len(self.memory) - len(self.u)
        rows = times[:, None] + torch.arange(past, device=times.device)
        history = self.memory[rows]
        return Instants(
            self.x[times],
            self.w[times.clamp(max=self.steps - 1)],
            history.permute(0, 2, 1, 3),
        )

    def to(self, device: torch.device) -> "Batch":
        """The same on another device."""
        return Batch(*(tensor.to(device, non_blocking=True) for tensor in self))


def scale(
    trajectories: Trajectories, scaling: Scaling, schema: Schema, roles: Roles, past_steps: int
) -> Batch:
    """Trajectories as the network sees them, float32, with `past_steps` rows of history."""
    states, inputs = past_columns(schema, roles)
    x, u, past, steps = trajectories.x, trajectories.u, trajectories.past, trajectories.u.shape[1]
    driven = np.concatenate([x[:, :steps, states], u[..., inputs]], axis=-1)
    memory = np.concatenate([past[:, past.shape[1] - past_steps :], driven], axis=1)
    return Batch(
        _time_first((x - scaling.x_centre) / scaling.x_scale),
        _time_first(u / scaling.u_scale),
        _time_first(trajectories.w / scaling.w_scale),
        _time_first((memory - scaling.past_centre) / scaling.past_scale),
    )


def _time_first(series: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(series.swapaxes(0, 1), dtype=np.float32))
