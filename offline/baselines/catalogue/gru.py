"""A recurrent network: an estimate of how well the next two seconds can be predicted at all.

An encoder turns the first state and the past half second into a hidden state; from there a gated
recurrent unit (Cho et al., 2014) is driven by the inputs, and its output is the change of speeds
and yaw rate in each step. For the car the path follows by kinematics; for other signals all states
are learned. The network is neither linear in the inputs nor convex to plan with.

It is trained on the same windows and on the same log error as the recommended model.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor, nn

from offline.baselines.baseline import Baseline
from offline.baselines.road_path import path_states
from offline.baselines.window_shape import require_windows
from offline.config import PAST_STEPS, PRESETS
from offline.data.dataset import Dataset
from offline.data.sampling import Batch, open_source
from offline.data.signals import Scaling, fit_scaling, last_rows
from offline.data.trajectories import Trajectories
from offline.model.losses import log_error
from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import VEHICLE, Schema
from rt_controller.contract.signals import MOTION
from rt_controller.report.table import Fact

MOTION_STATES = MOTION.stop
"""of the car: v_x, v_y, yaw rate"""

_BATCH = 2_000
"""windows predicted at once"""


@dataclass(frozen=True, slots=True)
class GruSettings:
    """Size and training of the network."""

    hidden: int = 64
    encoder: int = 128
    past_steps: int = PAST_STEPS
    steps: int = 10_000
    batch: int = 128
    learning_rate: float = 4e-3
    warm_up: float = 0.05
    """share of the steps in which the learning rate rises; after that a cosine takes it to zero"""
    weight_decay: float = 1e-5
    gradient_clip: float = 5.0
    seed: int = 0


class Network(nn.Module):
    """Scaled signals in, changes of the learned states out, in units of their spread."""

    def __init__(self, seen: int, driven: int, learned: int, encoder: int, hidden: int) -> None:
        super().__init__()
        self.encode = nn.Sequential(
            *(nn.Linear(seen, encoder), nn.SiLU()),
            *(nn.Linear(encoder, encoder), nn.SiLU()),
            *(nn.Linear(encoder, hidden), nn.Tanh()),
        )
        self.recur = nn.GRU(driven, hidden)
        self.change = nn.Linear(hidden, learned)

    def forward(self, seen: Tensor, driven: Tensor) -> Tensor:
        """Changes (K, batch, learned) of each step; seen (batch, s), driven (K, batch, d)."""
        hidden, _ = self.recur(driven, self.encode(seen)[None])
        return cast(Tensor, self.change(hidden))


@dataclass(frozen=True, slots=True)
class GruModel:
    """The network, and the scales of the signals."""

    network: Network
    past_steps: int
    is_car: bool
    """True if the path is computed from the motion, False if it is learned"""
    change_scale: Array
    """(n,) spread of each state's change over a step, in units of `x_scale`"""
    scaling: Scaling

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
        learned = MOTION_STATES if self.is_car else x0.shape[1]
        seen = torch.cat([x0[:, :learned], past.flatten(1)], dim=1)
        driven = u if self.is_car else torch.cat([u, w], dim=-1)
        changes = self.network(seen, driven) * _tensor(self.change_scale[:learned])
        states = x0[:, :learned] + torch.cumsum(changes, dim=0)
        if not self.is_car:
            return states
        centre, scale = _tensor(self.scaling.x_centre), _tensor(self.scaling.x_scale)
        motion = torch.cat([x0[None, :, :learned], states])
        motion = motion * scale[:learned] + centre[:learned]
        kappa = w[..., 0] * float(self.scaling.w_scale[0])
        path = path_states(
            torch, motion.transpose(0, 1), x0 * scale + centre, kappa.transpose(0, 1), VEHICLE.dt_s
        )
        path = (path - centre[learned:]) / scale[learned:]
        return torch.cat([states, path.transpose(0, 1)], dim=-1)

    def fit_info(self) -> tuple[Fact, ...]:
        """Size of the network, and how the path is made."""
        return (
            Fact("parameters", str(sum(each.numel() for each in self.network.parameters()))),
            Fact("hidden state", str(self.network.recur.hidden_size)),
            Fact("past periods", str(self.past_steps)),
            Fact("path", "integrated" if self.is_car else "learned"),
        )


def fit_gru(dataset: Dataset, settings: GruSettings = GruSettings()) -> GruModel:
    """The trained network; the same on every run on the same machine."""
    train = dataset.select("train")
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    sampling = PRESETS["recommended"].model_copy(update={"history_steps": settings.past_steps})
    source = open_source(sampling, dataset, scaling)
    with _one_thread(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        rng = torch.Generator().manual_seed(settings.seed)
        model = _untrained(train, scaling, dataset.schema, settings)
        parameters, rate = list(model.network.parameters()), settings.learning_rate
        optimizer = torch.optim.AdamW(parameters, lr=rate, weight_decay=settings.weight_decay)
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, rate, total_steps=settings.steps, pct_start=settings.warm_up
        )
        for _ in range(settings.steps):
            loss = log_error(_errors(model, source.draw(settings.batch, rng)))
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(parameters, settings.gradient_clip)
            optimizer.step()
            schedule.step()
    return model


def _untrained(
    train: Trajectories, scaling: Scaling, schema: Schema, settings: GruSettings
) -> GruModel:
    """A model of these sizes, with random weights."""
    changes = np.diff(train.x.astype(np.float64), axis=1) / scaling.x_scale
    is_car = schema == VEHICLE
    learned = MOTION_STATES if is_car else len(scaling.x_scale)
    seen = learned + settings.past_steps * len(scaling.past_scale)
    driven = len(scaling.u_scale) + (0 if is_car else len(scaling.w_scale))
    return GruModel(
        network=Network(seen, driven, learned, settings.encoder, settings.hidden),
        past_steps=settings.past_steps,
        is_car=is_car,
        change_scale=np.sqrt(np.square(changes).mean(axis=(0, 1))),
        scaling=scaling,
    )


def _errors(model: GruModel, batch: Batch) -> Tensor:
    """(n,) mean squared errors of the scaled states over the horizon."""
    past = batch.memory[: model.past_steps].transpose(0, 1)
    return batch.errors_of(model.predict_scaled(batch.x[0], past, batch.u, batch.w))


def _tensor(array: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread, whose order of summation is fixed; more are not faster for small batches."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


BASELINE = Baseline(fit=fit_gru, model_class="recurrent")
