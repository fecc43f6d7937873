"""How much of what a car can do is in the logs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.logs.episode import Episode, column
from offline.logs.log import Array
from offline.logs.mapping import Mapping
from offline.logs.quantity import Quantity
from rt_controller.contract.schema import Schema

BINS = 8


class Range(NamedTuple):
    """Where the samples of one signal lie."""

    name: str
    unit: str
    lowest: float
    q05: float
    median: float
    q95: float
    highest: float


class Occupancy(NamedTuple):
    """How the samples are spread over two signals."""

    across: str
    """what the columns are, with its unit"""
    down: str
    across_edges: Array
    """(BINS + 1,)"""
    down_edges: Array
    share: Array
    """(BINS, BINS) of all samples, rows by `down`"""

    @property
    def filled(self) -> float:
        """Share of the cells that hold any sample."""
        return float(np.count_nonzero(self.share) / self.share.size)


def find_ranges(episodes: Sequence[Episode], schema: Schema) -> list[Range]:
    """Ranges and quantiles of all signals that were measured, or told against a line."""
    blocks = [
        (np.concatenate([e.x for e in episodes]), schema.states),
        (np.concatenate([e.u for e in episodes]), schema.inputs),
    ]
    # Without path states the road is laid later, and its curvature is nobody's measurement.
    if episodes[0].x.shape[1] == len(schema.states):
        blocks.append((np.concatenate([e.w for e in episodes]), schema.exogenous))
    ranges = []
    for block, signals in blocks:
        for values, signal in zip(block.T, signals, strict=False):
            quantiles = np.quantile(values, [0.0, 0.05, 0.5, 0.95, 1.0])
            ranges.append(Range(signal.name, signal.unit, *(float(q) for q in quantiles)))
    return ranges


def find_occupancy(
    episodes: Sequence[Episode], mapping: Mapping, schema: Schema
) -> Occupancy | None:
    """Speed against lateral acceleration (speed times yaw rate), or else against steering.

    None where the logs have no speed, or neither of the others.
    """
    speed = mapping.name_of(Quantity.SPEED)
    yaw_rate, steer = mapping.name_of(Quantity.YAW_RATE), mapping.name_of(Quantity.STEERING)
    other = yaw_rate or steer
    if speed is None or other is None:
        return None
    vx = np.concatenate([column(e, schema, speed) for e in episodes])
    turn = np.concatenate([column(e, schema, other) for e in episodes])
    across = "lateral acceleration, m/s^2" if yaw_rate else f"{other}, rad"
    lateral = vx * turn if yaw_rate else turn
    counts, down_edges, across_edges = np.histogram2d(vx, lateral, bins=BINS)
    return Occupancy(across, f"{speed}, m/s", across_edges, down_edges, counts / counts.sum())
