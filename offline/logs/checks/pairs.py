"""Pairs of signals that depend on each other: cause and response, or two records of one motion."""

from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.arrays import Array
from rt_controller.mapping.quantity import Quantity

_SMOOTHING_S = 0.1
"""time over which derivatives are taken"""


class Relation(StrEnum):
    """Why two signals depend on each other."""

    STEERING = "steering"
    """a steering angle, times the speed if it is known, and the yaw rate"""
    PEDAL = "pedal"
    """a pedal, force or torque and the slope of the speed; a brake counts with its sign reversed"""
    SAME_MOTION = "same motion"
    """a quantity computed from the pose, or measured twice, and the signal of the same quantity"""


class Pair(NamedTuple):
    """A cause and its response, in the same episodes."""

    relation: Relation
    cause: str
    response: str
    causes: list[Array]
    """one (T,) for each episode"""
    responses: list[Array]


def find_pairs(episodes: Sequence[LogEpisode], mapping: LogMapping) -> list[Pair]:
    """Every pair of the mapping's signals and its pose."""
    speed, yaw_rate = mapping.name_of(Quantity.SPEED), mapping.name_of(Quantity.YAW_RATE)
    steer = mapping.name_of(Quantity.STEERING)
    pairs = []

    def signals(name: str) -> list[Array]:
        return [episode.signals[name].to_numpy() for episode in episodes]

    turned: list[Array] = []
    if steer:
        speeds = signals(speed) if speed else [np.ones(len(e)) for e in episodes]
        turned = [v * angle for v, angle in zip(speeds, signals(steer), strict=True)]
    if steer and yaw_rate:
        pairs.append(Pair(Relation.STEERING, steer, yaw_rate, turned, signals(yaw_rate)))
    if speed:
        gained = [slope(values, mapping.period_s) for values in signals(speed)]
        for quantity, sign in ((Quantity.DRIVE, 1.0), (Quantity.BRAKE, -1.0)):
            pedal = mapping.name_of(quantity)
            if pedal:
                pressed = [sign * values for values in signals(pedal)]
                pairs.append(Pair(Relation.PEDAL, pedal, f"slope of {speed}", pressed, gained))
    if mapping.pose:
        name = "slope of the pose's yaw"
        x, y, yaw = ([slope(e.pose[:, i], mapping.period_s) for e in episodes] for i in range(3))
        if steer:
            pairs.append(Pair(Relation.STEERING, steer, name, turned, yaw))
        if yaw_rate:
            pairs.append(Pair(Relation.SAME_MOTION, name, yaw_rate, yaw, signals(yaw_rate)))
        if speed:
            moved = [np.hypot(vx, vy) for vx, vy in zip(x, y, strict=True)]
            own = signals(speed)
            pairs.append(Pair(Relation.SAME_MOTION, "speed of the pose", speed, moved, own))
    for name in mapping.checks.signals:
        pairs += _second_measurement(name, episodes, mapping)
    return pairs


def _second_measurement(
    name: str, episodes: Sequence[LogEpisode], mapping: LogMapping
) -> Iterator[Pair]:
    """A signal that is no part of the data set, and what it measures too."""
    speed, yaw_rate = mapping.name_of(Quantity.SPEED), mapping.name_of(Quantity.YAW_RATE)
    own = [episode.signals[name].to_numpy() for episode in episodes]
    quantity = mapping.quantity(name)
    same = mapping.name_of(quantity)
    response, values = same, [e.signals[same].to_numpy() for e in episodes] if same else []
    if quantity is Quantity.LONGITUDINAL_ACCELERATION and speed:
        response = f"slope of {speed}"
        values = [slope(e.signals[speed].to_numpy(), mapping.period_s) for e in episodes]
    elif quantity is Quantity.LATERAL_ACCELERATION and speed and yaw_rate:
        response = f"{speed} times {yaw_rate}"
        values = [(e.signals[speed] * e.signals[yaw_rate]).to_numpy() for e in episodes]
    if response:
        yield Pair(Relation.SAME_MOTION, name, response, own, values)


def slope(values: Array, dt_s: float, reach: int | None = None) -> Array:
    """Derivative (T,), from differences over `reach` samples to both sides of each sample.

    None: a tenth of a second in all.
    """
    reach = reach or max(1, round(0.5 * _SMOOTHING_S / dt_s))
    inner = (values[2 * reach :] - values[: -2 * reach]) / (2 * reach * dt_s)
    return np.concatenate([np.repeat(inner[:1], reach), inner, np.repeat(inner[-1:], reach)])
