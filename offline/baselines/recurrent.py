"""A gated recurrent network, trained until its validation error is flat.

An encoder turns the first state and the past half second into the first hidden state; the inputs
then drive it from step to step. For a car on a road v_x, v_y and yaw rate are learned and the path
follows from them by kinematics; of other data all states are learned. The network is neither linear
in the inputs nor convex to plan with.

Windows, weights, mirror images, loss, horizon and optimiser are those of the recommended model. At
the highest learning rate the network is trained until its validation error stops to improve, or
little CPU time is left; then a cosine takes the rate to zero.
"""

import math
import time
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from offline.baselines.fitting import log_error as validation_score
from offline.baselines.fitting import scale_windows, tuning_windows
from offline.baselines.road_path import Learned, path_states, split_path
from offline.config import PAST_STEPS, RECOMMENDED, TrainingConfig
from offline.data.dataset import Dataset
from offline.data.sampling import open_source
from offline.data.signals import Scaling, fit_scaling
from offline.model.losses import horizon_of_step, log_error
from offline.training.optimizer import Optimizer, keep_lowest
from rt_controller.contract.arrays import Array

CONFIG = RECOMMENDED.model_copy(
    update={
        "steps": 60_000,
        "batch": 128,
        "learning_rate": 4e-3,
        "matrix_rate": 1.0,
        "horizon_growth": 0.1,
        "latents": 64,
        "symmetry": "trained",
        "history_steps": PAST_STEPS,
    }
)
"""`latents` is the size of the hidden state, `hidden` the widths of the encoder"""
MOST_CPU_S = 600.0
"""of the training, on one core"""
DECAY = 0.4
"""share of all steps over which the learning rate falls"""
WARM_UP = 1.0 / 120.0
"""share of the longest training over which it rises"""
PATIENCE = 10
"""the validation error is flat after so many evaluations without a lower one"""


class Gated(nn.Module):
    """A gated recurrent unit, whose hidden state gives the change of the states in each step.

    It has random weights at first. `seen` is the number of the signals that the encoder reads,
    `driven` that of inputs and exogenous signals, and spread (n,) is that of the change of each
    learned state over a step. Cho et al., 2014.
    """

    spread: Tensor

    def __init__(self, config: TrainingConfig, seen: int, driven: int, spread: Tensor) -> None:
        super().__init__()
        widths = [seen, *config.hidden]
        layers: list[nn.Module] = []
        for width, following in zip(widths, config.hidden, strict=False):
            layers += [nn.Linear(width, following), nn.SiLU()]
        self.encode = nn.Sequential(*layers, nn.Linear(widths[-1], config.latents), nn.Tanh())
        self.recur = nn.GRU(driven, config.latents)
        self.change = nn.Linear(config.latents, len(spread))
        self.register_buffer("spread", spread)

    def forward(self, x0: Tensor, seen: Tensor, driven: Tensor) -> Tensor:
        """Learned states (K, batch, n) after each step.

        x0 (batch, n) are the first ones, seen (batch, s) is what the encoder reads, and driven
        (K, batch, d) are inputs and exogenous signals.
        """
        hidden, _ = self.recur(driven, self.encode(seen)[None])
        return x0 + torch.cumsum(self.change(hidden) * self.spread, dim=0)


@dataclass(frozen=True, slots=True)
class RecurrentModel:
    """The network, and the scales of the signals."""

    network: Gated
    past_steps: int
    learned: Learned
    scaling: Scaling
    dt_s: float
    is_converged: bool = True
    """False if the training ended at a limit, before the validation error was flat"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), as `Predictor.predict`."""
        windows = scale_windows(self.scaling, self.past_steps, x0, past, U, W)
        x, u, w, rows = map(_tensor, windows)
        with torch.no_grad():
            scaled = self.predict_scaled(x, rows, u.transpose(0, 1), w.transpose(0, 1))
        states = scaled.transpose(0, 1).double().numpy() * self.scaling.x_scale
        return np.concatenate([x0[:, None], states + self.scaling.x_centre], axis=1)

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


def fit_network(dataset: Dataset, config: TrainingConfig = CONFIG) -> RecurrentModel:
    """The network of the smallest validation error.

    It is the same on every run on the same machine, unless its CPU time is used up. Steps whose
    gradient is not finite are left out.
    """
    threads = torch.get_num_threads()
    # The order of summation of one thread is fixed; more are not faster for small batches.
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            return _train(_untrained(dataset, config), dataset, config)
    finally:
        torch.set_num_threads(threads)


def _untrained(dataset: Dataset, config: TrainingConfig) -> RecurrentModel:
    """A model of this size, with random weights."""
    train, learned = dataset.select("train"), split_path(dataset.schema)
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    changes = np.diff(train.x[..., : learned.states].astype(np.float64), axis=1)
    spread = np.sqrt(np.square(changes).mean(axis=(0, 1))) / scaling.x_scale[: learned.states]
    acting = len(learned.exogenous)
    seen = learned.states + config.history_steps * len(scaling.past_scale) + acting
    network = Gated(config, seen, len(scaling.u_scale) + acting, _tensor(spread))
    return RecurrentModel(network, config.history_steps, learned, scaling, dataset.schema.dt_s)


def _train(model: RecurrentModel, dataset: Dataset, config: TrainingConfig) -> RecurrentModel:
    validation, source = tuning_windows(dataset), open_source(config, dataset, model.scaling)
    rng = torch.Generator().manual_seed(config.seed)
    network, best = model.network, model.network
    optimizer = Optimizer(network, config)
    scores: list[float] = []
    step, end, is_flat, begin_s = 0, config.steps, False, time.process_time()
    while step < end:
        optimizer.rate = rate_at(step, end, config)
        batch = source.draw(config.batch, rng)
        batch = batch.shorten(horizon_of_step(step, config, batch.steps))
        past = batch.memory[: model.past_steps].transpose(0, 1)
        predicted = model.predict_scaled(batch.x[0], past, batch.u, batch.w)
        loss = log_error(batch.errors_of(predicted))
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(network.parameters(), config.gradient_clip or math.inf)
        if torch.isfinite(norm):
            optimizer.step()
        step += 1
        if step % config.evaluate_every == 0 or step == end:
            scores.append(validation_score(model, validation))
            is_lowest, is_waiting = keep_lowest(scores, PATIENCE)
            if is_lowest:
                best = deepcopy(network)
            if step < round((1.0 - DECAY) * end):
                is_flat = is_waiting
                is_late = time.process_time() - begin_s >= (1.0 - DECAY) * MOST_CPU_S
                if is_flat or is_late:
                    end = round(step / (1.0 - DECAY))
    return replace(model, network=best, is_converged=is_flat)


def rate_at(step: int, end: int, config: TrainingConfig) -> float:
    """Learning rate of a step: it rises, is constant, and falls as half a cosine."""
    first = round((1.0 - DECAY) * end)
    rise = min(1.0, (step + 1) / (WARM_UP * config.steps))
    fallen = max(0.0, (step - first) / max(end - first, 1))
    return config.learning_rate * rise * 0.5 * (1.0 + math.cos(math.pi * fallen))


def _tensor(array: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))
