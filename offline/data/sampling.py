"""Batches of scaled trajectories, time first, and the sources they are drawn from."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import maximum_filter1d
from torch import Tensor

from offline.config import STEPS, TrainingConfig
from offline.data.dataset import Dataset
from offline.data.manifest import PARTS, Roads
from offline.data.recording import Anchor, Starts, cut, possible_starts
from offline.data.roads import roads_near_car
from offline.data.signals import (
    STANDARD_DEVIATIONS,
    Roles,
    Scaling,
    Trajectories,
    has_path,
    history_rows,
    mirror_signs,
    noise_matrix,
    past_names,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import PATH_STATES, Schema

VALIDATION_SEED = 40
"""of the roads near the car in the validation part"""


class Instants(NamedTuple):
    """What the encoder may read at some instants; the last axis holds the signals."""

    x: Tensor
    """(..., n) states"""
    w: Tensor
    """(..., p) exogenous signals"""
    past: Tensor
    """(..., H, h) history, oldest row first"""


class Batch(NamedTuple):
    """Scaled trajectories of K steps."""

    x: Tensor
    """(K+1, batch, n)"""
    u: Tensor
    """(K, batch, m)"""
    w: Tensor
    """(K, batch, p)"""
    memory: Tensor
    """(H+K, batch, h) rows of the history, from H steps before the start to the end"""
    weight: Tensor
    """(1, batch, 1) weight of each trajectory in a mean: below 1 if it was drawn more often"""

    @property
    def steps(self) -> int:
        return len(self.u)

    def shorten(self, steps: int) -> "Batch":
        """The first `steps` steps of every trajectory."""
        past = len(self.memory) - len(self.u)
        return self._replace(
            x=self.x[: steps + 1],
            u=self.u[:steps],
            w=self.w[:steps],
            memory=self.memory[: past + steps],
        )

    def at(self, times: Tensor) -> Instants:
        """The instants (M,) in 0..K; the exogenous signals at K are those of step K-1."""
        past = len(self.memory) - len(self.u)
        rows = times[:, None] + torch.arange(past, device=times.device)
        history = self.memory[rows]
        return Instants(
            self.x[times], self.w[times.clamp(max=self.steps - 1)], history.permute(0, 2, 1, 3)
        )

    def errors_of(self, predicted: Tensor) -> Tensor:
        """Mean squared error of each state over steps 1..K and the weighted trajectories, (n,).

        predicted is (K, batch, n).
        """
        return (self.weight * (self.x[1:] - predicted).square()).mean(dim=(0, 1))

    def chunks(self, size: int) -> "Iterator[tuple[float, Batch]]":
        """Batches of at most `size` trajectories, each with its share of all trajectories."""
        count = self.x.shape[1]
        for first in range(0, count, size):
            part = Batch(*(series[:, first : first + size] for series in self))
            yield part.x.shape[1] / count, part

    def to(self, device: torch.device) -> "Batch":
        """The same trajectories on another device."""
        return Batch(*(tensor.to(device, non_blocking=True) for tensor in self))


def scale(
    trajectories: Trajectories, scaling: Scaling, schema: Schema, roles: Roles, past_steps: int
) -> Batch:
    """Trajectories in float32, scaled, with `past_steps` rows of history."""
    memory = history_rows(trajectories, schema, roles, past_steps)
    return Batch(
        _time_first((trajectories.x - scaling.x_centre) / scaling.x_scale),
        _time_first(trajectories.u / scaling.u_scale),
        _time_first(trajectories.w / scaling.w_scale),
        _time_first((memory - scaling.past_centre) / scaling.past_scale),
        torch.ones((1, len(trajectories.x), 1)),
    )


class SliceSource:
    """The slices of the training part. Paper: section III-A, "non-overlapping trajectories".

    `draw` of every source returns `size` trajectories, drawn with replacement.
    """

    def __init__(self, dataset: Dataset, scaling: Scaling, past_steps: int) -> None:
        slices = dataset.select("train")
        self._all = scale(slices, scaling, dataset.schema, dataset.roles, past_steps)

    def draw(self, size: int, rng: torch.Generator) -> Batch:
        chosen = torch.randint(self._all.x.shape[1], (size,), generator=rng)
        return Batch(*(series[:, chosen] for series in self._all))


class WindowSource:
    """Any window of any training episode; episodes with poses get a random road in each draw.

    Raises:
        DatasetError: no episode is long enough.
    """

    def __init__(
        self,
        dataset: Dataset,
        scaling: Scaling,
        past_steps: int,
        rare_share: float = 0.0,
        near_roads: float = 0.0,
    ) -> None:
        """The share `rare_share` of the draws prefers windows with rare motion: `frequencies`.

        The share `near_roads` has roads near the car: `offline.data.roads`.
        """
        self._dataset, self._scaling, self._past_steps = dataset, scaling, past_steps
        self._roads = dataset.manifest.roads
        self._starts = possible_starts(dataset.recording, dataset.episodes("train"), past_steps)
        if not len(self._starts):
            raise DatasetError(
                f"expected episodes of at least {past_steps} periods of history and {STEPS} steps "
                f"in the training part, found none. Record longer episodes."
            )
        self._frequency = frequencies(rarity(dataset, scaling)[self._starts], rare_share)
        self._cumulative = np.cumsum(self._frequency / len(self._starts))
        self._near_share, self._near_car = near_roads, roads_near_car(dataset)

    def draw(self, size: int, rng: torch.Generator) -> Batch:
        uniform = self._cumulative[-1] * torch.rand(size, generator=rng, dtype=torch.float64)
        chosen = np.searchsorted(self._cumulative, uniform.numpy(), side="right")
        rows = self._starts[chosen]
        anchor = None if self._roads is None else _draw_roads(self._roads, size, rng)
        if anchor is not None and self._near_car is not None:
            is_near = torch.rand(size, generator=rng).numpy() < self._near_share
            normal = torch.randn(size, generator=rng, dtype=torch.float64).numpy()
            near = self._near_car.draw(rows, normal)
            anchor = anchor._replace(
                curvature_per_m=np.where(is_near, near, anchor.curvature_per_m)
            )
        starts = Starts(rows, np.zeros(size, dtype=np.int32), anchor)
        data = self._dataset
        windows = cut(data.recording, starts, data.schema, data.roles, past_steps=self._past_steps)
        batch = scale(windows, self._scaling, data.schema, data.roles, self._past_steps)
        weight = torch.from_numpy(1.0 / self._frequency[chosen]).float()
        return batch._replace(weight=weight[None, :, None])


def validation_batch(dataset: Dataset, scaling: Scaling, config: TrainingConfig) -> Batch:
    """The slices of the validation part; a share of them on roads near the car, as in training."""
    chosen = dataset.part[dataset.slices.episode] == PARTS.index("validation")
    starts, near_car = dataset.slices.take(chosen), roads_near_car(dataset)
    if config.windows == "all" and starts.anchor is not None and near_car is not None:
        rng, count = np.random.default_rng(VALIDATION_SEED), len(starts.row)
        is_near = rng.random(count) < config.near_roads
        near = near_car.draw(starts.row, rng.standard_normal(count))
        curvature = np.where(is_near, near, starts.anchor.curvature_per_m)
        starts = starts._replace(anchor=starts.anchor._replace(curvature_per_m=curvature))
    windows = cut(dataset.recording, starts, dataset.schema, dataset.roles)
    return scale(windows, scaling, dataset.schema, dataset.roles, config.history_steps)


def rarity(dataset: Dataset, scaling: Scaling) -> Array:
    """(T,) largest magnitude of a scaled state within the window that begins at each row.

    The states are those of the recording: with poses, without the path states, which depend on the
    road. The windows of sliding cars, which carry most of the squared error of lateral velocity,
    have the largest ones.
    """
    x = dataset.recording.x
    states = x.shape[1]
    largest = np.abs((x - scaling.x_centre[:states]) / scaling.x_scale[:states]).max(axis=1)
    return np.asarray(maximum_filter1d(largest, STEPS + 1, origin=-(STEPS // 2)))


def frequencies(rarity: Array, rare_share: float) -> Array:
    """(M,) how often each window is drawn, relative to drawing all windows alike.

    The share `rare_share` is drawn in proportion to the square of the rarity (M,), the rest
    uniformly. Weighted by 1 / frequency, means over the draws are unbiased estimates of means over
    all windows; no weight exceeds 1 / (1 - rare_share).
    """
    importance = rarity**2
    return np.asarray(1.0 - rare_share + rare_share * importance / importance.mean())


class MirroringSource:
    """Another source, with left and right exchanged in half of its trajectories."""

    def __init__(self, source: "Source", dataset: Dataset) -> None:
        schema, roles = dataset.schema, dataset.roles
        names = (
            schema.state_names,
            schema.input_names,
            schema.exogenous_names,
            past_names(schema, roles),
        )
        self._source = source
        self._signs = [torch.from_numpy(mirror_signs(each, roles)).float() for each in names]

    def draw(self, size: int, rng: torch.Generator) -> Batch:
        batch = self._source.draw(size, rng)
        is_mirrored = torch.rand(size, generator=rng)[:, None] < 0.5
        x, u, w, memory = (
            series * torch.where(is_mirrored, signs, torch.ones(()))
            for series, signs in zip(batch[:-1], self._signs, strict=True)
        )
        return Batch(x, u, w, memory, batch.weight)


class NoisySource:
    """Another source, with measurement noise on the first state and on the past before it.

    The standard deviations of each trajectory are those of `offline.data.signals` times a
    level drawn uniformly from 0 to `most`. The states that a prediction is compared with have none.
    """

    def __init__(
        self,
        source: "Source",
        dataset: Dataset,
        scaling: Scaling,
        most: float,
        *,
        on_path: bool = True,
    ) -> None:
        """Without `on_path` the place on the road has no noise: kinematics pass it on."""
        schema = dataset.schema
        heard = past_names(schema, dataset.roles)
        to_x = noise_matrix(schema.state_names, schema.dt_s) / scaling.x_scale
        if not on_path:
            to_x[:, PATH_STATES] = 0.0
        to_past = noise_matrix(heard, schema.dt_s) / scaling.past_scale
        self._source, self._most = source, most
        self._to_x, self._to_past = (
            torch.from_numpy(to_x).float(),
            torch.from_numpy(to_past).float(),
        )

    def draw(self, size: int, rng: torch.Generator) -> Batch:
        batch = self._source.draw(size, rng)
        past = len(batch.memory) - batch.steps
        level = self._most * torch.rand((1, size, 1), generator=rng)
        drawn = level * torch.randn((past + 1, size, len(self._to_x)), generator=rng)
        x, memory = batch.x.clone(), batch.memory.clone()
        x[0] += drawn[-1] @ self._to_x
        memory[:past] += drawn[:-1] @ self._to_past
        return batch._replace(x=x, memory=memory)


Source = SliceSource | WindowSource | MirroringSource | NoisySource


def open_source(config: TrainingConfig, dataset: Dataset, scaling: Scaling) -> Source:
    """The source that the configuration selects; mirrored only if the roles name odd signals."""
    source: Source
    if config.windows == "slices":
        source = SliceSource(dataset, scaling, config.history_steps)
    else:
        # The paper's terms have no weights.
        rare_share = config.rare_share if config.objective == "horizon" else 0.0
        source = WindowSource(dataset, scaling, config.history_steps, rare_share, config.near_roads)
    if config.symmetry == "trained" and dataset.roles.odd is not None:
        source = MirroringSource(source, dataset)
    is_noisy = config.noise and set(STANDARD_DEVIATIONS) & set(dataset.schema.state_names)
    if not is_noisy:
        return source
    on_path = not (config.separate_motion and has_path(dataset.schema))
    return NoisySource(source, dataset, scaling, config.noise, on_path=on_path)


def _draw_roads(roads: Roads, size: int, rng: torch.Generator) -> Anchor:
    curvatures = np.array(roads.curvatures_per_m)
    chosen = torch.randint(len(curvatures), (size,), generator=rng).numpy()
    uniform = torch.rand((2, size), generator=rng, dtype=torch.float64)
    ey, epsi = 2.0 * uniform.numpy() - 1.0
    return Anchor(curvatures[chosen], roads.ey_m * ey, roads.epsi_rad * epsi)


def _time_first(series: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(series.swapaxes(0, 1), dtype=np.float32))
