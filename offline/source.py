"""Where the batches of a training run come from: the paper's slices, or any window of any drive."""

from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from offline.batch import Batch, scale
from offline.config import TrainingConfig
from offline.dataset import Dataset
from offline.manifest import Roads
from offline.recording import Starts, cut, possible_starts
from offline.road_frame import Anchor
from offline.roles import mirror_signs, past_names
from offline.scaling import Scaling
from rt_controller.contract.errors import DatasetError


class Source(Protocol):
    """Scaled trajectories, drawn at random."""

    def draw(self, size: int, dice: torch.Generator) -> Batch:
        """`size` trajectories, drawn with replacement."""
        ...


class SliceSource:
    """The slices of the training part. Paper: section III-A, "non-overlapping trajectories"."""

    def __init__(self, dataset: Dataset, scaling: Scaling, past_steps: int) -> None:
        slices = dataset.select("train")
        self._all = scale(slices, scaling, dataset.schema, dataset.roles, past_steps)

    def draw(self, size: int, dice: torch.Generator) -> Batch:
        chosen = torch.randint(self._all.x.shape[1], (size,), generator=dice)
        return Batch(*(series[:, chosen] for series in self._all))


class WindowSource:
    """Any window of any drive of the training part; on a new road each time if it has poses.

    Raises:
        DatasetError: no drive is long enough.
    """

    def __init__(self, dataset: Dataset, scaling: Scaling, past_steps: int) -> None:
        self._dataset, self._scaling, self._past_steps = dataset, scaling, past_steps
        self._roads = dataset.manifest.roads
        self._starts = possible_starts(dataset.recording, dataset.episodes("train"), past_steps)
        if not len(self._starts):
            raise DatasetError(
                f"expected drives with room for {past_steps} periods of history and a window of "
                f"80, found none in the training part. Record longer drives."
            )

    def draw(self, size: int, dice: torch.Generator) -> Batch:
        chosen = torch.randint(len(self._starts), (size,), generator=dice).numpy()
        anchor = None if self._roads is None else _lay_roads(self._roads, size, dice)
        starts = Starts(self._starts[chosen], np.zeros(size, dtype=np.int32), anchor)
        data = self._dataset
        windows = cut(data.recording, starts, data.schema, data.roles, past_steps=self._past_steps)
        return scale(windows, self._scaling, data.schema, data.roles, self._past_steps)


class MirroringSource:
    """Another source, half of whose trajectories have left and right exchanged."""

    def __init__(self, source: Source, dataset: Dataset) -> None:
        schema, roles = dataset.schema, dataset.roles
        names = (
            schema.state_names,
            schema.input_names,
            schema.exogenous_names,
            past_names(schema, roles),
        )
        self._source = source
        self._signs = [torch.from_numpy(mirror_signs(each, roles)).float() for each in names]

    def draw(self, size: int, dice: torch.Generator) -> Batch:
        batch = self._source.draw(size, dice)
        is_mirrored = torch.rand(size, generator=dice)[:, None] < 0.5
        return Batch(
            *(
                series * torch.where(is_mirrored, signs, torch.ones(()))
                for series, signs in zip(batch, self._signs, strict=True)
            )
        )


def open_source(config: TrainingConfig, dataset: Dataset, scaling: Scaling) -> Source:
    """The source that the configuration asks for.

    A data set that does not say which signals change sign has no mirror image, and is not
    mirrored.
    """
    kind = WindowSource if config.windows == "all" else SliceSource
    source: Source = kind(dataset, scaling, config.history_steps)
    if config.mirror and dataset.roles.odd is not None:
        source = MirroringSource(source, dataset)
    return source


def _lay_roads(roads: Roads, size: int, dice: torch.Generator) -> Anchor:
    curvatures = np.array(roads.curvatures_per_m)
    chosen = torch.randint(len(curvatures), (size,), generator=dice).numpy()
    errors = _symmetric(size, dice)
    return Anchor(curvatures[chosen], roads.ey_m * errors[0], roads.epsi_rad * errors[1])


def _symmetric(size: int, dice: torch.Generator) -> np.ndarray:
    drawn: Tensor = torch.rand((2, size), generator=dice, dtype=torch.float64)
    return np.asarray(2.0 * drawn.numpy() - 1.0)
