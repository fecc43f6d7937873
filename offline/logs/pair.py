"""Signals that have to fit each other: what moves a car and how it moves, or one motion told twice.

The checks of time and of units both live on these.
"""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from offline.logs.episode import Episode, column
from offline.logs.log import Array
from offline.logs.mapping import Mapping
from offline.logs.quantity import Quantity
from rt_controller.contract.schema import Schema

_SMOOTHING_S = 0.1
"""over which derivatives are taken"""


class Tie(StrEnum):
    """Why two signals fit each other."""

    STEERED = "steered"
    """a steering angle, times the speed where it is known, and how fast the car turns"""
    PEDALLED = "pedalled"
    """a pedal, force or torque and the slope of the speed; a brake counts with its sign reversed"""
    SAME = "same"
    """what the pose says of the car, and the signal that says the same"""


class Pair(NamedTuple):
    """A cause and its response, in the same episodes."""

    tie: Tie
    cause: str
    response: str
    causes: list[Array]
    """one (T,) an episode"""
    responses: list[Array]


def find_pairs(episodes: Sequence[Episode], mapping: Mapping, schema: Schema) -> list[Pair]:
    """Every pair that the mapping's signals and its pose make."""
    speed, yaw_rate = mapping.name_of(Quantity.SPEED), mapping.name_of(Quantity.YAW_RATE)
    steer = mapping.name_of(Quantity.STEERING)
    pairs = []

    def signals(name: str) -> list[Array]:
        return [column(episode, schema, name) for episode in episodes]

    turned: list[Array] = []
    if steer:
        ways = signals(speed) if speed else [np.ones(len(e.x)) for e in episodes]
        turned = [way * angle for way, angle in zip(ways, signals(steer), strict=True)]
    if steer and yaw_rate:
        pairs.append(Pair(Tie.STEERED, steer, yaw_rate, turned, signals(yaw_rate)))
    if speed:
        gained = [slope(values, schema.dt_s) for values in signals(speed)]
        for quantity, sign in ((Quantity.DRIVE, 1.0), (Quantity.BRAKE, -1.0)):
            pedal = mapping.name_of(quantity)
            if pedal:
                pressed = [sign * values for values in signals(pedal)]
                pairs.append(Pair(Tie.PEDALLED, pedal, f"slope of {speed}", pressed, gained))
    if mapping.pose:
        name = "slope of the pose's yaw"
        x, y, yaw = ([slope(e.pose[:, i], schema.dt_s) for e in episodes] for i in range(3))
        if steer:
            pairs.append(Pair(Tie.STEERED, steer, name, turned, yaw))
        if yaw_rate:
            pairs.append(Pair(Tie.SAME, name, yaw_rate, yaw, signals(yaw_rate)))
        if speed:
            moved = [np.hypot(vx, vy) for vx, vy in zip(x, y, strict=True)]
            pairs.append(Pair(Tie.SAME, "speed of the pose", speed, moved, signals(speed)))
    return pairs


def slope(values: Array, dt_s: float) -> Array:
    """Derivative (T,), from differences over a tenth of a second around each sample."""
    reach = max(1, round(0.5 * _SMOOTHING_S / dt_s))
    inner = (values[2 * reach :] - values[: -2 * reach]) / (2 * reach * dt_s)
    return np.concatenate([np.repeat(inner[:1], reach), inner, np.repeat(inner[-1:], reach)])
