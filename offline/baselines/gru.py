"""An upper bound: a recurrent network that is free to learn any motion of the car.

An encoder makes a memory of the first state and the half second before it; from there a gated
recurrent unit (Cho et al., 2014) is driven by the inputs, and what it remembers after each step
says by how much speeds and yaw rate change. On the car the path follows exactly from these; data
of other signals have all their states learned. It is neither linear in the inputs nor convex to
plan with: it shows how much of the next two seconds can be known at all.

Trained on the same windows as the recommended model, on the same figure: the log error over the
whole horizon.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from offline.baselines.finding import Finding
from offline.baselines.road_path import path_states
from offline.baselines.window_shape import WindowShape
from offline.batch import Batch
from offline.config import PRESETS
from offline.dataset import Dataset
from offline.horizon_loss import log_error
from offline.lengths import PAST_STEPS
from offline.scaling import fit_scaling
from offline.source import open_source
from rt_controller.contract.schema import VEHICLE

Array = NDArray[np.float64]

MOTION_STATES = 3
"""of the car: v_x, v_y, yaw rate"""

_PREDICTED_AT_ONCE = 2_000


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
    """share of the steps, before a cosine takes the rate to zero"""
    weight_decay: float = 1e-5
    gradient_clip: float = 5.0
    seed: int = 0


class Network(nn.Module):
    """Scaled signals in, changes of the learned states out, in their own spread."""

    def __init__(self, seen: int, driven: int, learned: int, encoder: int, hidden: int) -> None:
        super().__init__()
        self.remember = nn.Sequential(
            nn.Linear(seen, encoder),
            nn.SiLU(),
            nn.Linear(encoder, encoder),
            nn.SiLU(),
            nn.Linear(encoder, hidden),
            nn.Tanh(),
        )
        self.recur = nn.GRU(driven, hidden)
        self.change = nn.Linear(hidden, learned)

    def forward(self, seen: Tensor, driven: Tensor) -> Tensor:
        """Changes (K, batch, learned) of each step; seen (batch, s), driven (K, batch, d)."""
        remembered, _ = self.recur(driven, self.remember(seen)[None])
        return cast(Tensor, self.change(remembered))


@dataclass(frozen=True, slots=True)
class GruModel:
    """The weights, and what it takes to use them on physical signals."""

    weights: NDArray[np.float32]
    """all parameters of the `Network`, one after the other"""
    hidden: int
    encoder: int
    past_steps: int
    knows_road: bool
    """whether the path is integrated, not learned"""
    dt_s: float
    change_scale: Array
    """(n,) spread of each state's change over a step, in units of `x_scale`"""
    x_centre: Array
    x_scale: Array
    u_scale: Array
    w_scale: Array
    past_centre: Array
    past_scale: Array

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n).

        Raises:
            DatasetError: the shapes are not those of the data it was fitted to.
        """
        n, m, p, h = (len(s) for s in (self.x_scale, self.u_scale, self.w_scale, self.past_scale))
        WindowShape(n, m, p, h, self.past_steps).require(x0, past, U, W)
        network = self._network()
        states = np.empty((len(x0), U.shape[1] + 1, n))
        states[:, 0] = x0
        for first in range(0, len(x0), _PREDICTED_AT_ONCE):
            rows = slice(first, first + _PREDICTED_AT_ONCE)
            last = past[rows, past.shape[1] - self.past_steps :]
            with torch.no_grad():
                predicted = roll_out(
                    network,
                    self,
                    _tensor((x0[rows] - self.x_centre) / self.x_scale),
                    _tensor((last - self.past_centre) / self.past_scale),
                    _tensor(U[rows] / self.u_scale).transpose(0, 1),
                    _tensor(W[rows] / self.w_scale).transpose(0, 1),
                )
            scaled = predicted.transpose(0, 1).double().numpy()
            states[rows, 1:] = scaled * self.x_scale + self.x_centre
        return states

    def findings(self) -> tuple[Finding, ...]:
        """How large the network is, and what it leaves to kinematics."""
        return (
            Finding("parameters", str(len(self.weights))),
            Finding("memory", str(self.hidden)),
            Finding("past periods", str(self.past_steps)),
            Finding("path", "integrated" if self.knows_road else "learned"),
        )

    def _network(self) -> Network:
        network = build(self)
        vector_to_parameters(torch.from_numpy(self.weights.copy()), network.parameters())
        return network.eval()


def build(like: GruModel) -> Network:
    """A network of the sizes of this model, with random weights."""
    n, remembered = len(like.x_scale), like.past_steps * len(like.past_scale)
    learned = MOTION_STATES if like.knows_road else n
    driven = len(like.u_scale) + (0 if like.knows_road else len(like.w_scale))
    return Network(learned + remembered, driven, learned, like.encoder, like.hidden)


def roll_out(
    network: Network, of: GruModel, x0: Tensor, past: Tensor, u: Tensor, w: Tensor
) -> Tensor:
    """Scaled states (K, batch, n) of steps 1..K, all arguments scaled and `u`, `w` time first."""
    learned = MOTION_STATES if of.knows_road else x0.shape[1]
    seen = torch.cat([x0[:, :learned], past.flatten(1)], dim=1)
    driven = u if of.knows_road else torch.cat([u, w], dim=-1)
    changes = network(seen, driven) * _tensor(of.change_scale[:learned])
    states = x0[:, :learned] + torch.cumsum(changes, dim=0)
    if not of.knows_road:
        return states
    centre, scale = _tensor(of.x_centre), _tensor(of.x_scale)
    motion = torch.cat([x0[None, :, :learned], states])
    motion = motion * scale[:learned] + centre[:learned]
    path = path_states(
        torch,
        motion.transpose(0, 1),
        x0 * scale + centre,
        (w[..., 0] * float(of.w_scale[0])).transpose(0, 1),
        of.dt_s,
    )
    path = (path - centre[learned:]) / scale[learned:]
    return torch.cat([states, path.transpose(0, 1)], dim=-1)


def fit_gru(dataset: Dataset, settings: GruSettings = GruSettings()) -> GruModel:
    """The network after its training; the same on every run on the same machine."""
    train = dataset.select("train")
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    changes = np.diff(train.x.astype(np.float64), axis=1) / scaling.x_scale
    blank = GruModel(
        weights=np.zeros(0, np.float32),
        hidden=settings.hidden,
        encoder=settings.encoder,
        past_steps=settings.past_steps,
        knows_road=dataset.schema == VEHICLE,
        dt_s=dataset.schema.dt_s,
        change_scale=np.sqrt(np.square(changes).mean(axis=(0, 1))),
        x_centre=scaling.x_centre,
        x_scale=scaling.x_scale,
        u_scale=scaling.u_scale,
        w_scale=scaling.w_scale,
        past_centre=scaling.past_centre,
        past_scale=scaling.past_scale,
    )
    sampling = PRESETS["recommended"].model_copy(update={"history_steps": settings.past_steps})
    source = open_source(sampling, dataset, scaling)
    with _one_thread(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        dice = torch.Generator().manual_seed(settings.seed)
        network = build(blank)
        optimizer = torch.optim.AdamW(
            network.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer,
            settings.learning_rate,
            total_steps=settings.steps,
            pct_start=settings.warm_up,
        )
        for _ in range(settings.steps):
            loss = log_error(_errors(network, blank, source.draw(settings.batch, dice)))
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(network.parameters(), settings.gradient_clip)
            optimizer.step()
            schedule.step()
    weights = parameters_to_vector(network.parameters()).detach().numpy().copy()
    return replace(blank, weights=weights)


def _errors(network: Network, of: GruModel, batch: Batch) -> Tensor:
    """(n,) mean squared errors of the scaled states over the horizon."""
    past = batch.memory[: of.past_steps].transpose(0, 1)
    predicted = roll_out(network, of, batch.x[0], past, batch.u, batch.w)
    return (predicted - batch.x[1:]).square().mean(dim=(0, 1))


def _tensor(array: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


@contextmanager
def _one_thread() -> Iterator[None]:
    """Sums of one thread come in one order; batches this small gain nothing from more."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
