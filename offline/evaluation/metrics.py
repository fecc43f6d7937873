"""Errors of open-loop predictions over two seconds, in the units of Table II, and their ratios.

The state is lifted once, at the first instant, and the errors of steps 1..K count; the first state
is measured and does not count. Squared errors are averaged over steps and trajectories. Two errors
of a ratio have the same draws of episodes, so the difficulty of an episode cancels, and the
interval of a ratio is narrower than those of its two errors.
Paper: section IV, Table II.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.evaluation.bootstrap import Estimate, estimate
from offline.evaluation.predictor import Predictor, prediction_errors
from offline.evaluation.test_sets import TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import SYMBOLS, Schema
from rt_controller.mapping.units import unit_of_name

PROGRESS = "ds"
"""progress per period: the speed once more (correlation 0.997 on the training data), so the
geometric mean over all states counts the speed twice"""
GEOMETRIC_MEAN = "geometric_mean"
WITHOUT_PROGRESS = f"{GEOMETRIC_MEAN}_without_{PROGRESS}"

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
    def symbol(self) -> str:
        """The name as in the documents: v_x of vx."""
        return SYMBOLS.get(self.name, self.name)

    @property
    def squared_unit(self) -> str:
        """Unit of a squared error: (km/h)², m²."""
        if self.unit in ("", "1"):
            return "1"
        return f"{self.unit}²" if self.unit.isalpha() else f"({self.unit})²"


def state_units(schema: Schema) -> tuple[StateUnit, ...]:
    """The states of a schema, in their order."""
    units = []
    for state in schema.states:
        unit, factor = _TABLE_UNITS.get(state.unit, (state.unit, 1.0))
        ending = "_per_" if "_per_" in state.name else "_"
        name = state.name.rpartition(ending)[0] if unit_of_name(state.name) else state.name
        units.append(StateUnit(name, unit, factor))
    return tuple(units)


def absolute_errors(model: Predictor, test: TestSet, states: Sequence[StateUnit]) -> Array:
    """Absolute errors (N, K, n) of each step in the units of `states`; infinite if not finite."""
    errors = prediction_errors(model, test.trajectories)
    with np.errstate(over="ignore"):
        errors *= [state.per_si for state in states]
    return np.where(np.isnan(errors), np.inf, np.abs(errors))


def mean_names(states: Sequence[StateUnit]) -> tuple[str, ...]:
    """The geometric means of these states: of all, and without `PROGRESS` if it is one of them."""
    has_progress = len(states) > 1 and PROGRESS in (state.name for state in states)
    return (GEOMETRIC_MEAN, *((WITHOUT_PROGRESS,) if has_progress else ()))


def ratios_of(above: Array, below: Array, states: Sequence[StateUnit]) -> Estimate:
    """Ratio of two errors, given their draws (1 + R, n): of each state, then of `mean_names`.

    There is no interval if one of the errors has only the sample.
    """
    draws = min(len(above), len(below))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = above[:draws] / below[:draws]
    columns = [ratios, geometric_mean(ratios)]
    if WITHOUT_PROGRESS in mean_names(states):
        others = [i for i, state in enumerate(states) if state.name != PROGRESS]
        columns.append(geometric_mean(ratios[:, others]))
    return estimate(np.column_stack(columns))


def geometric_mean(ratios: Array) -> Array:
    """Geometric mean over the last axis, the states; 0 if one of the ratios is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.exp(np.log(ratios).mean(axis=-1)))
