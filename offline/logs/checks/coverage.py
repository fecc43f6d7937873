"""Which part of a car's operating range the logs contain."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.schema import Schema
from rt_controller.mapping.quantity import Quantity

BINS = 8


@dataclass(frozen=True, slots=True)
class Range:
    """Quantiles of one signal."""

    name: str
    unit: str
    lowest: float
    q05: float
    median: float
    q95: float
    highest: float


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Joint histogram of two signals."""

    across: str
    """signal of the columns, with its unit"""
    down: str
    across_edges: tuple[float, ...]
    """BINS + 1"""
    down_edges: tuple[float, ...]
    share: tuple[tuple[float, ...], ...]
    """(BINS, BINS) of all samples, rows by `down`"""
    filled: float
    """share of the cells that contain a sample"""


def find_ranges(episodes: Sequence[LogEpisode], schema: Schema) -> list[Range]:
    """Ranges and quantiles of all signals that were measured, or computed from a line."""
    signals = pd.concat([episode.signals for episode in episodes])
    quantiles = signals.quantile([0.0, 0.05, 0.5, 0.95, 1.0])
    return [
        Range(signal.name, signal.unit, *quantiles[signal.name].tolist())
        for signal in (*schema.states, *schema.inputs, *schema.exogenous)
        if signal.name in signals
    ]


def find_occupancy(episodes: Sequence[LogEpisode], mapping: LogMapping) -> Occupancy | None:
    """Speed and lateral acceleration (speed times yaw rate), or else speed and steering.

    None if the logs have no speed, or neither of the others.
    """
    speed = mapping.name_of(Quantity.SPEED)
    yaw_rate, steer = mapping.name_of(Quantity.YAW_RATE), mapping.name_of(Quantity.STEERING)
    if speed is None or not (yaw_rate or steer):
        return None
    signals = pd.concat([episode.signals for episode in episodes])
    lateral = signals[speed] * signals[yaw_rate] if yaw_rate else signals[steer]
    counts, down_edges, across_edges = np.histogram2d(signals[speed], lateral, bins=BINS)
    return Occupancy(
        "lateral acceleration, m/s^2" if yaw_rate else f"{steer}, rad",
        f"{speed}, m/s",
        tuple(across_edges.tolist()),
        tuple(down_edges.tolist()),
        tuple(map(tuple, (counts / counts.sum()).tolist())),
        float(np.mean(counts > 0)),
    )
