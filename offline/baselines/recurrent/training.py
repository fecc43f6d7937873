"""Training of a recurrent network until its validation error is flat.

The windows, their weights, mirror images and the log error are those of the recommended model. At
the highest learning rate the network is trained until its validation error stops to improve, or to
the limit of steps; then a cosine takes the rate to zero. Muon (Jordan et al., 2024) updates the
matrices, AdamW the vectors.
"""

import math
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import nn

from offline.baselines.baseline import Baseline
from offline.baselines.recurrent.model import RecurrentModel, Training
from offline.baselines.recurrent.network import Size, build
from offline.baselines.road_path import split_path
from offline.baselines.score import log_error as validation_score
from offline.baselines.score import tuning_windows
from offline.baselines.threads import one_thread
from offline.config import PAST_STEPS, PRESETS
from offline.data.dataset import Dataset
from offline.data.sampling import open_source
from offline.data.signals import Scaling, fit_scaling
from offline.data.trajectories import Trajectories
from offline.model.losses import log_error

_SHOWN_SCORES = 8


@dataclass(frozen=True, slots=True)
class Settings:
    """Size and training of a network."""

    size: Size
    past_steps: int = PAST_STEPS
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


def recurrent(settings: Settings) -> Baseline:
    """The baseline with these settings; its short fit takes a twentieth of the steps."""
    short = replace(settings, most_steps=settings.most_steps // 20)
    return Baseline(
        fit=partial(fit_network, settings=settings),
        fit_short=partial(fit_network, settings=short),
        model_class="recurrent",
    )


def fit_network(dataset: Dataset, settings: Settings) -> RecurrentModel:
    """The network of the smallest validation error; the same on every run on the same machine.

    Steps whose gradient is not finite are left out.
    """
    train, validation = dataset.select("train"), tuning_windows(dataset)
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    sampling = PRESETS["recommended"].model_copy(update={"history_steps": settings.past_steps})
    source = open_source(sampling, dataset, scaling)
    scores: list[float] = []
    step, end, is_flat = 0, settings.most_steps, False
    with one_thread(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        rng = torch.Generator().manual_seed(settings.seed)
        model = _untrained(train, scaling, dataset, settings)
        best = model.network
        parameters = list(model.network.parameters())
        optimizers = _optimizers(parameters, settings)
        while step < end:
            _set_rate(optimizers, rate_at(step, end, settings))
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
                if not is_flat and step < begin_of_decay(end, settings):
                    is_flat = has_flattened(scores, settings)
                    end = round(step / (1.0 - settings.decay)) if is_flat else end
    training = Training(step, is_flat, _curve(scores, step, settings))
    return replace(model, network=best, training=training)


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


def _set_rate(optimizers: tuple[torch.optim.Optimizer, ...], rate: float) -> None:
    for optimizer in optimizers:
        for group in optimizer.param_groups:
            group["lr"] = rate


def _curve(scores: list[float], steps: int, settings: Settings) -> tuple[tuple[int, float], ...]:
    """At most `_SHOWN_SCORES` of the scores, evenly spread, the last one among them."""
    every = -(-len(scores) // _SHOWN_SCORES)
    chosen = range(len(scores) - 1, -1, -every)[::-1]
    return tuple((min((i + 1) * settings.evaluate_every, steps), scores[i]) for i in chosen)


def _untrained(
    train: Trajectories, scaling: Scaling, dataset: Dataset, settings: Settings
) -> RecurrentModel:
    """A model of this size, with random weights."""
    learned = split_path(dataset.schema)
    changes = np.diff(train.x[..., : learned.states].astype(np.float64), axis=1)
    spread = np.sqrt(np.square(changes).mean(axis=(0, 1))) / scaling.x_scale[: learned.states]
    acting = len(learned.exogenous)
    network = build(
        settings.size,
        seen=learned.states + settings.past_steps * len(scaling.past_scale) + acting,
        driven=len(scaling.u_scale) + acting,
        spread=torch.from_numpy(spread).float(),
    )
    return RecurrentModel(network, settings.past_steps, learned, scaling, dataset.schema.dt_s)
