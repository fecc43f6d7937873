"""A gated recurrent network, trained until its validation error is flat.

An encoder turns the first state and the past half second into the first hidden state; the inputs
then drive it from step to step. For a car on a road v_x, v_y and yaw rate are learned and the path
follows from them by kinematics; of other data all states are learned. The network is neither linear
in the inputs nor convex to plan with.

The windows, their weights, mirror images and the log error are those of the recommended model. At
the highest learning rate the network is trained until its validation error stops to improve, or its
CPU time would not suffice for more; then a cosine takes the rate to zero. Muon (Jordan et al.,
2024) updates the matrices, AdamW the vectors.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from offline.baselines.baseline import require_windows
from offline.baselines.fitting import log_error as validation_score
from offline.baselines.fitting import tuning_windows
from offline.baselines.road_path import Learned, path_states, split_path
from offline.config import PAST_STEPS, PRESETS
from offline.data.dataset import Dataset
from offline.data.sampling import Batch, open_source
from offline.data.signals import Scaling, Trajectories, fit_scaling, last_rows
from offline.model.losses import log_error
from rt_controller.contract.arrays import Array
from rt_controller.report.table import Fact

_SHOWN_SCORES = 8
"""at most, evenly spread, the last one among them"""
_BATCH = 2_000
"""windows predicted at once"""


@dataclass(frozen=True, slots=True)
class Settings:
    """Size and training of a network."""

    hidden: int = 64
    """size of the hidden state"""
    encoder: int = 128
    """width of the two hidden layers of the encoder"""
    past_steps: int = PAST_STEPS
    most_cpu_s: float = 600.0
    """of the training, on one core"""
    most_steps: int = 60_000
    batch: int = 128
    learning_rate: float = 4e-3
    warm_up: int = 500
    """steps over which the learning rate rises"""
    decay: float = 0.4
    """share of all steps over which it falls"""
    first_horizon: int = 8
    """steps of the first roll-outs"""
    horizon_growth: float = 0.1
    """share of `most_steps` after which roll-outs have all steps"""
    evaluate_every: int = 500
    flat_gain: float = 0.02
    """the validation error is flat if it has lost less than this share in the last third of at
    least `least_evaluations`"""
    least_evaluations: int = 30
    weight_decay: float = 1e-5
    gradient_clip: float = 5.0
    seed: int = 0


class Gated(nn.Module):
    """A gated recurrent unit, whose hidden state gives the change of the states in each step.

    It has random weights at first. `seen` is the number of the signals that the encoder reads,
    `driven` that of inputs and exogenous signals, and spread (n,) is that of the change of each
    learned state over a step. Cho et al., 2014.
    """

    spread: Tensor

    def __init__(self, settings: Settings, seen: int, driven: int, spread: Tensor) -> None:
        super().__init__()
        width, hidden = settings.encoder, settings.hidden
        self.encode = nn.Sequential(
            *(nn.Linear(seen, width), nn.SiLU()),
            *(nn.Linear(width, width), nn.SiLU()),
            *(nn.Linear(width, hidden), nn.Tanh()),
        )
        self.recur = nn.GRU(driven, hidden)
        self.change = nn.Linear(hidden, len(spread))
        self.register_buffer("spread", spread)

    def forward(self, x0: Tensor, seen: Tensor, driven: Tensor) -> Tensor:
        """Learned states (K, batch, n) after each step.

        x0 (batch, n) are the first ones, seen (batch, s) is what the encoder reads, and driven
        (K, batch, d) are inputs and exogenous signals.
        """
        hidden, _ = self.recur(driven, self.encode(seen)[None])
        return x0 + torch.cumsum(self.change(hidden) * self.spread, dim=0)


class Training(NamedTuple):
    """How a network was trained."""

    steps: int
    is_flat: bool
    """True if the training ended because the validation error did, False at a limit"""
    curve: tuple[tuple[int, float], ...]
    """steps, and the log error on the validation part after them"""


@dataclass(frozen=True, slots=True)
class RecurrentModel:
    """The network, and the scales of the signals."""

    network: Gated
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

    @property
    def is_converged(self) -> bool:
        """False if the training ended before the validation error was flat."""
        return self.training is None or self.training.is_flat

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
            Fact("end of the training", "validation error is flat" if is_flat else "not converged"),
            Fact("validation log error", course),
        )


def fit_network(dataset: Dataset, settings: Settings = Settings()) -> RecurrentModel:
    """The network of the smallest validation error.

    It is the same on every run on the same machine, unless its CPU time is used up. Steps whose
    gradient is not finite are left out.
    """
    train, validation = dataset.select("train"), tuning_windows(dataset)
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    sampling = PRESETS["recommended"].model_copy(update={"history_steps": settings.past_steps})
    source = open_source(sampling, dataset, scaling)
    scores: list[float] = []
    step, end, is_flat = 0, settings.most_steps, False
    begin_s = looked_s = time.process_time()
    with _one_thread(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        rng = torch.Generator().manual_seed(settings.seed)
        model = _untrained(train, scaling, dataset, settings)
        best = model.network
        parameters = list(model.network.parameters())
        optimizers = _optimizers(parameters, settings)
        while step < end:
            for group in (each for optimizer in optimizers for each in optimizer.param_groups):
                group["lr"] = rate_at(step, end, settings)
            batch = source.draw(settings.batch, rng)
            batch = batch.shorten(horizon_of_step(step, batch.steps, settings))
            loss = log_error(model.errors(batch))
            model.network.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            norm = nn.utils.clip_grad_norm_(parameters, settings.gradient_clip)
            if torch.isfinite(norm):
                for optimizer in optimizers:
                    optimizer.step()
            step += 1
            if step % settings.evaluate_every == 0 or step == end:
                scores.append(validation_score(model, validation))
                if scores[-1] == min(scores):
                    best = deepcopy(model.network)
                if step < begin_of_decay(end, settings):
                    now_s = time.process_time()
                    elapsed_s, interval_s, looked_s = now_s - begin_s, now_s - looked_s, now_s
                    is_flat = has_flattened(scores, settings)
                    if is_flat or is_late(step, elapsed_s, interval_s, settings):
                        end = round(step / (1.0 - settings.decay))
    every = -(-len(scores) // _SHOWN_SCORES)
    shown = range(len(scores) - 1, -1, -every)[::-1]
    curve = tuple((min((i + 1) * settings.evaluate_every, step), scores[i]) for i in shown)
    return replace(model, network=best, training=Training(step, is_flat, curve))


def is_late(step: int, elapsed_s: float, interval_s: float, settings: Settings) -> bool:
    """True if a decay after one more interval between evaluations would exceed the CPU time."""
    next_step = step + settings.evaluate_every
    ahead = settings.evaluate_every + next_step * settings.decay / (1.0 - settings.decay)
    return elapsed_s + ahead * interval_s / settings.evaluate_every > settings.most_cpu_s


def begin_of_decay(end: int, settings: Settings) -> int:
    """Step at which the learning rate begins to fall in a training of `end` steps."""
    return round((1.0 - settings.decay) * end)


def rate_at(step: int, end: int, settings: Settings) -> float:
    """Learning rate of a step: it rises, is constant, and falls as half a cosine."""
    first = begin_of_decay(end, settings)
    rise = min(1.0, (step + 1) / settings.warm_up)
    fallen = max(0.0, (step - first) / max(end - first, 1))
    return settings.learning_rate * rise * 0.5 * (1.0 + math.cos(math.pi * fallen))


def horizon_of_step(step: int, longest: int, settings: Settings) -> int:
    """Steps of the roll-outs at this training step: a network is trained on short ones first."""
    grown = min(1.0, step / (settings.horizon_growth * settings.most_steps))
    first = min(settings.first_horizon, longest)
    return first + int((longest - first) * grown)


def has_flattened(scores: list[float], settings: Settings) -> bool:
    """True if the last third of these log errors has no value below the others by `flat_gain`."""
    if len(scores) < settings.least_evaluations:
        return False
    recent = len(scores) // 3
    return min(scores[-recent:]) > min(scores[:-recent]) + math.log1p(-settings.flat_gain)


def _optimizers(
    parameters: list[nn.Parameter], settings: Settings
) -> tuple[torch.optim.Optimizer, ...]:
    rate, decay = settings.learning_rate, settings.weight_decay
    return (
        torch.optim.Muon(
            [each for each in parameters if each.ndim == 2],
            rate,
            weight_decay=decay,
            adjust_lr_fn="match_rms_adamw",
        ),
        torch.optim.AdamW(
            [each for each in parameters if each.ndim != 2], rate, weight_decay=decay
        ),
    )


def _untrained(
    train: Trajectories, scaling: Scaling, dataset: Dataset, settings: Settings
) -> RecurrentModel:
    """A model of this size, with random weights."""
    learned = split_path(dataset.schema)
    changes = np.diff(train.x[..., : learned.states].astype(np.float64), axis=1)
    spread = np.sqrt(np.square(changes).mean(axis=(0, 1))) / scaling.x_scale[: learned.states]
    acting = len(learned.exogenous)
    network = Gated(
        settings,
        seen=learned.states + settings.past_steps * len(scaling.past_scale) + acting,
        driven=len(scaling.u_scale) + acting,
        spread=torch.from_numpy(spread).float(),
    )
    return RecurrentModel(network, settings.past_steps, learned, scaling, dataset.schema.dt_s)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread, whose order of summation is fixed; more are not faster for small batches."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _tensor(array: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))
