"""The trajectories that models are evaluated on.

- library: slices of the test episodes, 480 for each curvature that models may be trained on;
- new-roads: the same drives on curvatures that the library leaves out. The road does not act on
  the car, so another road can be laid under a drive exactly (`offline.data.recording`);
- bends: the same drives on roads that turn about as the car does (`offline.data.roads`), radius 8
  to 250 m, one set of left and one of right bends;
- noise: the library with noise on what a model hears, the first state and the states of the past.
  The states that a prediction is compared with, the inputs and the curvature have none. The draws
  are seeded, the same for all models, and those of another level are the same times its factor;
- robustness, varied, sliding, fast, friction, mass, braking: simulated with other cars, roads or
  drivers (`offline.evaluation.simulated_sets`).

Paper: section IV, 2,400 open-loop test trajectories.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from offline.data.dataset import Dataset
from offline.data.manifest import Imported, Origin
from offline.data.recording import Starts, cut
from offline.data.roads import roads_near_car
from offline.data.signals import STANDARD_DEVIATIONS, Roles, Trajectories, noise_matrix, past_names
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import Schema

LIBRARY, NEW_ROADS, BENDS = "library", "new-roads", "bends"
ROBUSTNESS, VARIED = "robustness", "varied"
NOISE, SLIDING, FAST, BRAKING = "noise", "sliding", "fast", "braking"
FRICTION, MASS = "friction", "mass"
SET_NAMES = (
    *(LIBRARY, NEW_ROADS, BENDS),
    *(ROBUSTNESS, VARIED),
    *(NOISE, SLIDING, FAST, BRAKING),
    *(FRICTION, MASS),
)
"""names of `--sets`; bends, noise, friction and mass stand for several sets each"""

TRAJECTORIES_PER_CURVATURE = 480
"""times five curvatures: the paper's 2,400 test trajectories"""

NEW_CURVATURES_PER_M = (-1e-3, 1e-3, 3e-3)
"""within the range of the library's curvatures, but not among them"""

BEND_RADII_M = (8.0, 250.0)
BENDS_SEED = 49

NOISE_LEVELS = (1.0, 3.0)
NOISE_SEED = 48


@dataclass(frozen=True, slots=True)
class TestSet:
    """Trajectories that models are evaluated on."""

    name: str
    description: str
    trajectories: Trajectories
    data_sha256: str
    """hash of the data set that they are from"""
    is_of_logs: bool = False
    """recorded, not simulated"""


def choose_sets(names: Sequence[str]) -> tuple[str, ...]:
    """The test sets of these names, all if there are none; the library is always among them.

    Raises:
        ConfigError: a name is unknown.
    """
    unknown = [name for name in names if name not in SET_NAMES]
    if unknown:
        raise ConfigError(
            f"--sets: expected some of {', '.join(SET_NAMES)}, found {', '.join(unknown)}."
        )
    return tuple(name for name in SET_NAMES if not names or name in names or name == LIBRARY)


def library_set(dataset: Dataset, per_curvature: int = TRAJECTORIES_PER_CURVATURE) -> TestSet:
    """The first slices of each curvature of the test part, or all if the data have no roads.

    Raises:
        DatasetError: the data set has no test part.
    """
    description = f"test part of {describe_source(dataset.origin)}"
    return cut_set(dataset, LIBRARY, description, slices_of_test_part(dataset, per_curvature))


def new_roads_set(
    dataset: Dataset, per_curvature: int = TRAJECTORIES_PER_CURVATURE
) -> TestSet | None:
    """The drives of `library_set`, each on every new curvature.

    None if the data have no roads, or have all of these curvatures.
    """
    starts, roads = slices_of_test_part(dataset, per_curvature), dataset.manifest.roads
    if starts.anchor is None or roads is None:
        return None
    curvatures = tuple(
        kappa
        for kappa in NEW_CURVATURES_PER_M
        if not np.any(np.isclose(kappa, roads.curvatures_per_m, atol=1e-9))
    )
    if not curvatures:
        return None
    listed = ", ".join(f"{1e3 * kappa:+g}e-3" for kappa in curvatures)
    description = f"the same drives on roads of {listed} 1/m, which are not in the library"
    count = len(starts.row)
    starts = starts.take(np.tile(np.arange(count), len(curvatures)))
    anchor = starts.anchor and starts.anchor._replace(curvature_per_m=np.repeat(curvatures, count))
    return cut_set(dataset, NEW_ROADS, description, starts._replace(anchor=anchor))


def bends_sets(dataset: Dataset) -> list[TestSet]:
    """Left and right bends of the radii `BEND_RADII_M` under the slices of the test part.

    Empty if such roads cannot be laid under the data.
    """
    starts, near_car = slices_of_test_part(dataset), roads_near_car(dataset)
    if starts.anchor is None or near_car is None:
        return []
    normal = np.random.default_rng(BENDS_SEED).standard_normal(len(starts.row))
    curvature = near_car.draw(starts.row, normal)
    starts = starts._replace(anchor=starts.anchor._replace(curvature_per_m=curvature))
    tightest, widest = BEND_RADII_M
    found = []
    for side, signed in (("left", curvature), ("right", -curvature)):
        chosen = (signed >= 1.0 / widest) & (signed <= 1.0 / tightest)
        description = f"the same drives in {side} bends, radius {tightest:g} to {widest:g} m"
        if chosen.any():
            found.append(cut_set(dataset, f"{BENDS}-{side}", description, starts.take(chosen)))
    return found


def noisy_set(library: TestSet, level: float, schema: Schema, roles: Roles) -> TestSet | None:
    """The library with noise of that level; None if no state has one."""
    heard = past_names(schema, roles)
    noisy = [name for name in schema.state_names if name in STANDARD_DEVIATIONS]
    if not noisy:
        return None
    x, past = library.trajectories.x, library.trajectories.past
    rng = np.random.default_rng(NOISE_SEED)
    drawn = level * np.stack(
        [rng.normal(size=(len(x), 1 + past.shape[1])) for _ in STANDARD_DEVIATIONS], axis=-1
    )
    at_start, before = x.copy(), past.copy()
    at_start[:, 0] += drawn[:, -1] @ noise_matrix(schema.state_names, schema.dt_s)
    before += drawn[:, :-1] @ noise_matrix(heard, schema.dt_s)
    listed = ", ".join(noisy)
    return replace(
        library,
        name=f"{NOISE}-{level:g}",
        description=f"{LIBRARY} with {level:g} times the measurement noise on {listed}",
        trajectories=library.trajectories._replace(x=at_start, past=before),
    )


def slices_of_test_part(dataset: Dataset, per_curvature: int | None = None) -> Starts:
    """Slices of the test part in stored order, at most `per_curvature` of each curvature."""
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


def cut_set(dataset: Dataset, name: str, description: str, starts: Starts) -> TestSet:
    """The windows of these starts as a test set."""
    trajectories = cut(dataset.recording, starts, dataset.schema, dataset.roles)
    is_of_logs = isinstance(dataset.origin, Imported)
    return TestSet(name, description, trajectories, dataset.sha256, is_of_logs)


def describe_source(origin: Origin) -> str:
    """What the episodes are from, as text."""
    if isinstance(origin, Imported):
        return f"{len(origin.files)} imported logs in {origin.episodes} stretches"
    return f"{origin.episodes} episodes of seed {origin.seed}"
