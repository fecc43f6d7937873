"""What models are judged on: held-out drives, the same drives on new roads, and other cars.

- library: slices of the test episodes, 480 for each curvature that models may have learned from;
- new-roads: the same drives laid on curvatures between those. A drive feels no road, so this is
  exact and costs no simulation (`offline.road_frame`);
- robustness: drives of cars of another mass on roads of another grip (`offline.robustness`).

Paper: section IV, 2,400 open-loop test trajectories.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from offline.dataset import Dataset
from offline.excitation import Recipe
from offline.manifest import Driven, Imported, Origin
from offline.recording import Starts, cut
from offline.trajectories import Trajectories
from rt_controller.contract.errors import DatasetError

Array = NDArray[np.float64]

LIBRARY, NEW_ROADS, ROBUSTNESS = "library", "new-roads", "robustness"
SET_NAMES = (LIBRARY, NEW_ROADS, ROBUSTNESS)

TRAJECTORIES_PER_CURVATURE = 480
"""five curvatures of these make the paper's 2,400 test trajectories"""

NEW_CURVATURES_PER_M = (-1e-3, 1e-3, 3e-3)
"""held out of the library, and inside it"""


@dataclass(frozen=True, slots=True)
class TestSet:
    """Trajectories that models are judged on."""

    name: str
    words: str
    """what they are, for people"""
    trajectories: Trajectories
    curvature_per_m: Array | None
    """(N,) of the road of each; None where the data know no roads"""
    data_sha256: str
    """hash of the data set they were cut from"""

    @property
    def n_trajectories(self) -> int:
        return len(self.trajectories.episode)

    @property
    def n_episodes(self) -> int:
        return len(np.unique(self.trajectories.episode))

    @property
    def curvatures_per_m(self) -> tuple[float, ...]:
        """The roads there are, from right to left."""
        if self.curvature_per_m is None:
            return ()
        return tuple(float(kappa) for kappa in np.unique(self.curvature_per_m))


def library_set(dataset: Dataset, per_curvature: int = TRAJECTORIES_PER_CURVATURE) -> TestSet:
    """The first slices of each curvature of the test part, or all where there are no roads.

    Raises:
        DatasetError: there is none.
    """
    words = f"test part of {_source(dataset.origin)}"
    return _cut_set(dataset, LIBRARY, words, _judged_slices(dataset, per_curvature))


def new_roads_set(
    dataset: Dataset, per_curvature: int = TRAJECTORIES_PER_CURVATURE
) -> TestSet | None:
    """The drives of `library_set`, each on every road that the library leaves out.

    None where the data know no roads, or leave none out.
    """
    starts, roads = _judged_slices(dataset, per_curvature), dataset.manifest.roads
    if starts.anchor is None or roads is None:
        return None
    curvatures = tuple(
        kappa
        for kappa in NEW_CURVATURES_PER_M
        if not np.any(np.isclose(kappa, roads.curvatures_per_m, atol=1e-9))
    )
    if not curvatures:
        return None
    named = ", ".join(f"{1e3 * kappa:+g}e-3" for kappa in curvatures)
    words = f"the same drives, each on the roads of {named} 1/m, which the library leaves out"
    count = len(starts.row)
    every = starts.take(np.tile(np.arange(count), len(curvatures)))
    return _cut_set(dataset, NEW_ROADS, words, _on_roads(every, np.repeat(curvatures, count)))


def robustness_set(dataset: Dataset) -> TestSet:
    """All slices of the drives that `offline.robustness` makes."""
    return _cut_set(dataset, ROBUSTNESS, _ranges(dataset.origin), _judged_slices(dataset, None))


def _judged_slices(dataset: Dataset, per_curvature: int | None) -> Starts:
    """Slices of the test part, in stored order, at most so many of each curvature."""
    starts = dataset.slices.take(np.isin(dataset.slices.episode, dataset.episodes("test")))
    if not len(starts.row):
        raise DatasetError(
            f"expected a data set with test trajectories, found none among its "
            f"{dataset.manifest.trajectories} ({dataset.sha256:.16}…). Make a longer one."
        )
    if starts.anchor is None:
        return starts
    curvature = starts.anchor.curvature_per_m
    chosen = [np.flatnonzero(curvature == kappa)[:per_curvature] for kappa in np.unique(curvature)]
    return starts.take(np.sort(np.concatenate(chosen)))


def _on_roads(starts: Starts, curvature_per_m: Array) -> Starts:
    """The same windows with the same errors at their start, on roads of curvatures (N,)."""
    if starts.anchor is None:
        return starts
    return starts._replace(anchor=starts.anchor._replace(curvature_per_m=curvature_per_m))


def _cut_set(dataset: Dataset, name: str, words: str, starts: Starts) -> TestSet:
    return TestSet(
        name=name,
        words=words,
        trajectories=cut(dataset.recording, starts, dataset.schema, dataset.roles),
        curvature_per_m=starts.anchor and starts.anchor.curvature_per_m,
        data_sha256=dataset.sha256,
    )


def _source(origin: Origin) -> str:
    if isinstance(origin, Imported):
        return f"{len(origin.files)} imported logs in {origin.episodes} stretches"
    return f"{origin.episodes} episodes of seed {origin.seed}"


def _ranges(origin: Origin) -> str:
    """What may differ from the car and the road of the library."""
    recipe = origin.recipe if isinstance(origin, Driven) else Recipe()
    ranges = {"road friction": recipe.road_friction, "mass times": recipe.mass_factor}
    differs = [f"{name} {r[0]:g} to {r[1]:g}" for name, r in ranges.items() if r is not None]
    return ", ".join([_source(origin), *differs])
