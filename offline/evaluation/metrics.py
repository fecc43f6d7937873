"""Errors of open-loop predictions over two seconds, in the units of Table I, and their ratios.

The state is lifted once, at the first instant, and the errors of steps 1..K count; the first state
is measured and does not count. Squared errors are averaged over steps and trajectories. Two errors
of a ratio have the same draws of episodes, so the difficulty of an episode cancels, and the
interval of a ratio is narrower than those of its two errors.
Paper: section IV, Table I.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.data.signals import Rows
from offline.evaluation.bootstrap import Estimate, estimate, mean_draws
from offline.evaluation.predictor import Predictor, prediction_errors
from offline.evaluation.test_sets import TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema

PROGRESS = "ds"
"""progress per period: the speed once more (correlation 0.997 on the training data), so the
geometric mean over all states counts the speed twice"""
WITHOUT_PROGRESS = f"geometric_mean_without_{PROGRESS}"

MEANS = ("geometric_mean", WITHOUT_PROGRESS)

Figures = dict[str, Any]
"""a tree for JSON; a value with an interval is {value, low, high}"""

_TABLE_UNITS = {
    "m/s": ("km/h", 3.6),
    "rad/s": ("deg/s", float(np.degrees(1.0))),
    "rad": ("deg", float(np.degrees(1.0))),
}
"""by SI unit: unit in tables, and the factor to it; other units are not converted"""


class StateUnit(NamedTuple):
    """Name and unit of a state in tables."""

    name: str
    """without the unit"""
    unit: str
    per_si: float
    """value in `unit` = per_si * value in the state's own unit"""

    @property
    def key(self) -> str:
        """Name with unit for JSON: "vx_kmh"."""
        return "_".join(filter(None, (self.name, _suffix(self.unit))))

    @property
    def squared_key(self) -> str:
        """Key of a squared error: "vx_kmh_squared"."""
        return f"{self.key}_squared"

    @property
    def squared_unit(self) -> str:
        """Unit of a squared error as the paper prints it: "(km/h)^2", "m^2"."""
        if self.unit in ("", "1"):
            return "1"
        return f"{self.unit}^2" if self.unit.isalpha() else f"({self.unit})^2"


def state_units(schema: Schema) -> tuple[StateUnit, ...]:
    """The states of a schema, in their order."""
    units = []
    for state in schema.states:
        unit, factor = _TABLE_UNITS.get(state.unit, (state.unit, 1.0))
        name = state.name.removesuffix(f"_{_suffix(state.unit)}")
        units.append(StateUnit(name, unit, factor))
    return tuple(units)


def _suffix(unit: str) -> str:
    """A unit as the end of a name: "mps" of "m/s", "kmh" of "km/h", "per_m" of "1/m", "" of "1"."""
    if unit in ("", "1"):
        return ""
    if unit == "km/h":
        return "kmh"
    if unit.startswith("1/"):
        return "per_" + _suffix(unit.removeprefix("1/"))
    return re.sub(r"[^a-z0-9]", "", unit.lower().replace("/", "p"))


@dataclass(frozen=True)
class TrajectoryErrors:
    """Squared errors of N trajectories, averaged over the steps; n states in squared units.

    The draws are those of `offline.evaluation.bootstrap`: the sample, then R resamples.
    """

    mse: Array
    """(N, n); infinite where a prediction is not finite"""
    episode: NDArray[np.int32]
    """(N,)"""
    diverged: int = 0
    """number of trajectories with a prediction that is not finite"""

    def take(self, rows: Rows) -> "TrajectoryErrors":
        """The errors of these trajectories."""
        return TrajectoryErrors(self.mse[rows], self.episode[rows])

    @cached_property
    def mean_draws(self) -> Array:
        """Means (1 + R, n) over the trajectories. Paper: Table I."""
        return mean_draws(self.mse, self.episode)


def errors_on(
    model: Predictor, test: TestSet, columns: Sequence[StateUnit]
) -> tuple[Array, TrajectoryErrors]:
    """Absolute errors (N, K, n) of each step, infinite where not finite; means of squares."""
    errors = prediction_errors(model, test.trajectories)
    with np.errstate(over="ignore"):
        errors *= [column.per_si for column in columns]
        magnitude = np.where(np.isnan(errors), np.inf, np.abs(errors))
        mse = np.square(magnitude).mean(axis=1)
    diverged = int(np.count_nonzero(~np.isfinite(errors).all(axis=(1, 2))))
    return magnitude, TrajectoryErrors(mse, test.trajectories.episode, diverged)


def by_key(found: Estimate, keys: Iterable[str]) -> Figures:
    """{value, low, high} by key, of the entries of an estimate (n,)."""
    numbers = np.transpose(found).tolist()
    return {key: Estimate(*row)._asdict() for key, row in zip(keys, numbers, strict=True)}


def ratios_of(above: Array, below: Array, columns: Sequence[StateUnit]) -> Figures:
    """Ratio of two errors, given their draws (1 + R, n): of each state, and geometric means.

    The second mean is without `PROGRESS`, if that is one of several states. There is no interval if
    one of the errors has only the sample.
    """
    draws = min(len(above), len(below))
    names = [column.name for column in columns]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above[:draws] / below[:draws]
    means = {"geometric_mean": geometric_mean(ratios)}
    others = [i for i, name in enumerate(names) if name != PROGRESS]
    if 0 < len(others) < len(names):
        means[WITHOUT_PROGRESS] = geometric_mean(ratios[:, others])
    return by_key(estimate(np.column_stack([ratios, *means.values()])), [*names, *means])


def geometric_mean(ratios: Array) -> Array:
    """Geometric mean over the last axis, the states; 0 if one of the ratios is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.exp(np.log(ratios).mean(axis=-1)))
