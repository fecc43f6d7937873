"""The parts of the test sets that errors are reported for: one list, one type.

A part is a whole test set, or the trajectories of one in a range of sideslip, brake, first speed or
on one road.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.evaluation.test_sets import FAST, LIBRARY, NEW_ROADS, SLIDING, TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema

SIDESLIP_DEG = (0.0, 2.0, 4.0, 6.0, 9.0, 16.0, np.inf)
"""limits of the parts; a simulated car that slides by more than 15 deg ends its episode"""
BRAKE_N = (0.0, float(np.nextafter(0.0, 1.0)), 75.0, np.inf)
"""none, up to half of the largest brake input, and more"""
FIRST_SPEED_KMH = {
    LIBRARY: (0.0, 50.0, 80.0, 110.0, 145.0, np.inf),
    FAST: (130.0, 150.0, 180.0, np.inf),
}


class Part(NamedTuple):
    """Some or all trajectories of a test set."""

    name: str
    """that of the set if it has all of them; otherwise set, quantity and range"""
    description: str
    test: TestSet
    rows: NDArray[np.bool_]
    """(N,) True for the trajectories of the part"""

    @property
    def is_whole(self) -> bool:
        """True of a whole test set."""
        return self.name == self.test.name

    @property
    def n_trajectories(self) -> int:
        return int(self.rows.sum())

    @property
    def n_episodes(self) -> int:
        return len(np.unique(self.test.trajectories.episode[self.rows]))

    @property
    def size(self) -> str:
        """Name, number of trajectories and of episodes, as text."""
        name = "the logs held back for the test" if self.test.is_of_logs else self.name
        episodes = "1 episode" if self.n_episodes == 1 else f"{self.n_episodes} episodes"
        return f"{name}, {self.n_trajectories} trajectories of {episodes}"


def whole_part(test: TestSet) -> Part:
    """All trajectories of a test set."""
    rows = np.ones(len(test.trajectories.episode), dtype=np.bool_)
    return Part(test.name, test.description, test, rows)


def parts_of(sets: Sequence[TestSet], schema: Schema) -> tuple[Part, ...]:
    """The whole test sets, then the slices of them that their signals allow."""
    slices = (part for test in sets for part in _slices(test, schema))
    return (*map(whole_part, sets), *slices)


def _slices(test: TestSet, schema: Schema) -> Iterator[Part]:
    x, u, w, _, _ = test.trajectories
    names = (schema.state_names, schema.input_names, schema.exogenous_names)
    signals = {
        name: array[..., i].astype(np.float64)
        for array, of in zip((x, u, w), names, strict=True)
        for i, name in enumerate(of)
    }
    if {"vx_mps", "vy_mps"} <= signals.keys() and test.name in (LIBRARY, SLIDING):
        sideslip = np.abs(np.arctan2(signals["vy_mps"], signals["vx_mps"]))
        peak_deg = np.degrees(sideslip).max(axis=1)
        yield from _between(test, "largest sideslip", "deg", peak_deg, SIDESLIP_DEG)
    if "brake_n" in signals and test.name == LIBRARY:
        peak_n = signals["brake_n"].max(axis=1)
        yield from _between(test, "largest brake", "N", peak_n, BRAKE_N)
    if "vx_mps" in signals and test.name in FIRST_SPEED_KMH:
        first_kmh = 3.6 * signals["vx_mps"][:, 0]
        yield from _between(test, "first speed", "km/h", first_kmh, FIRST_SPEED_KMH[test.name])
    if "curvature_per_m" in signals and test.name in (LIBRARY, NEW_ROADS):
        curvature = signals["curvature_per_m"]
        if np.all(curvature == curvature[:, :1]):
            roads = [(kappa, np.nextafter(kappa, np.inf)) for kappa in np.unique(curvature[:, 0])]
            limits = np.ravel(roads).tolist()
            yield from _between(test, "curvature", "1/m", curvature[:, 0], limits)


def _between(
    test: TestSet, quantity: str, unit: str, values: Array, limits: Sequence[float]
) -> Iterator[Part]:
    """Slices between neighbouring limits, the lower one included.

    One without a trajectory is left out, and so is one that is the whole set.
    """
    for low, high in pairwise(limits):
        rows = (values >= low) & (values < high)
        first = f"{round(low, 9):g}"
        if high == np.nextafter(low, np.inf):
            label = f"{first} {unit}"
        elif np.isfinite(high):
            label = f"{first} to {high:g} {unit}"
        else:
            label = f"{first} {unit} and more"
        if 0 < np.count_nonzero(rows) < len(rows):
            text = f"trajectories of {test.name}: {quantity} {label}"
            yield Part(f"{test.name}, {quantity} {label}", text, test, rows)
