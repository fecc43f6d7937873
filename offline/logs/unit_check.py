"""Signals that cannot be in the unit they claim, told by what one says of the other.

Between a speed, a steering angle, a yaw rate and a pose there are proportions that a car fixes. If
one of them is off by 3.6, 57.3, 9.81 or a power of ten, or if one log has another proportion than
all others by such a factor, somebody has mixed up units.
"""

from collections.abc import Sequence
from math import log, pi
from statistics import median_low
from typing import NamedTuple

import numpy as np

from offline.logs.episode import Episode, column
from offline.logs.finding import Finding
from offline.logs.mapping import Mapping
from offline.logs.pair import Tie, find_pairs
from offline.logs.quantity import Quantity
from rt_controller.contract.schema import Schema

LEAST_CORRELATION = 0.8
"""below, two signals say too little of each other"""
FACTOR_TOLERANCE = 0.12
"""share by which a proportion may miss a known factor and still be that mix-up"""
LEAST_SPEED_MPS = 3.0
LARGEST_ACCELERATION_MPS2 = 45.0
"""of speed times yaw rate in all but one of a thousand samples: 4.5 g"""
TURNING_LENGTH_M = (1.0, 200.0)
"""speed times steering over yaw rate: a wheelbase, times the steering ratio where the angle is
the steering wheel's, and more where the car understeers"""


class MixUp(NamedTuple):
    """A pair of units that people confuse."""

    factor: float
    words: str


MIX_UPS = (
    MixUp(3.6, "km/h taken for m/s"),
    MixUp(180.0 / pi, "degrees taken for radians"),
    MixUp(9.80665, "g taken for m/s^2"),
    MixUp(100.0, "% taken for a share"),
    MixUp(1000.0, "a thousand"),
)


class Proportion(NamedTuple):
    """How much of the response comes with one unit of the cause, in one log."""

    file: str
    tie: Tie
    cause: str
    response: str
    slope: float
    correlation: float


def find_proportions(
    episodes: Sequence[Episode], mapping: Mapping, schema: Schema
) -> list[Proportion]:
    """The proportions that each log has while its car rolls; none without a speed."""
    speed = mapping.name_of(Quantity.SPEED)
    if speed is None:
        return []
    found = []
    for file in dict.fromkeys(episode.path.name for episode in episodes):
        own = [episode for episode in episodes if episode.path.name == file]
        rolls = np.concatenate([column(e, schema, speed) for e in own]) >= LEAST_SPEED_MPS
        for pair in find_pairs(own, mapping, schema):
            c, r = (np.concatenate(each)[rolls] for each in (pair.causes, pair.responses))
            power = float(c @ c * (r @ r))
            if power > 0.0:
                size, match = float(c @ r / (c @ c)), float(c @ r) / power**0.5
                cause = f"{speed} times {pair.cause}" if pair.tie is Tie.STEERED else pair.cause
                found.append(Proportion(file, pair.tie, cause, pair.response, size, match))
    return found


def remarks(
    proportions: Sequence[Proportion], episodes: Sequence[Episode], mapping: Mapping, schema: Schema
) -> list[Finding]:
    """One finding for each suspicion that units are mixed up."""
    return [
        *_between_files(proportions),
        *_against_pose(proportions),
        *_turning_length(proportions, mapping),
        *_accelerations(episodes, mapping, schema),
    ]


def _between_files(proportions: Sequence[Proportion]) -> list[Finding]:
    findings = []
    for pair in dict.fromkeys((each.cause, each.response) for each in proportions):
        same = [
            each
            for each in proportions
            if (each.cause, each.response) == pair and abs(each.correlation) >= LEAST_CORRELATION
        ]
        if len(same) < 2:
            continue
        usual = median_low(each.slope for each in same)
        for each in same:
            mix_up = known_factor(each.slope / usual) if usual else None
            if mix_up:
                findings.append(
                    Finding(
                        "units",
                        each.file,
                        f"{each.response} over {each.cause} is {each.slope:.4g}, in the other "
                        f"logs {usual:.4g}: {mix_up.words}? All logs of one import share their "
                        f"units; convert that one",
                    )
                )
    return findings


def _against_pose(proportions: Sequence[Proportion]) -> list[Finding]:
    findings = []
    for each in proportions:
        if each.tie is not Tie.SAME or abs(each.correlation) < LEAST_CORRELATION:
            continue
        mix_up = known_factor(each.slope)
        if mix_up or each.slope < 0.0:
            words = mix_up.words if mix_up else "a wrong sign"
            findings.append(
                Finding(
                    "units",
                    each.response,
                    f"{each.slope:.4g} times the {each.cause} in {each.file}, expected once: "
                    f"{words}? Correct unit or sign in the mapping, of it or of the pose",
                )
            )
    return findings


def _turning_length(proportions: Sequence[Proportion], mapping: Mapping) -> list[Finding]:
    steer, yaw_rate = mapping.name_of(Quantity.STEERING), mapping.name_of(Quantity.YAW_RATE)
    findings = []
    for each in proportions:
        if each.tie is not Tie.STEERED or each.response != yaw_rate:
            continue
        if abs(each.correlation) < LEAST_CORRELATION:
            continue
        length_m = 1.0 / each.slope if each.slope else float("inf")
        low, high = TURNING_LENGTH_M
        if not low <= length_m <= high:
            words = "a wrong sign" if length_m < 0.0 else "degrees taken for radians"
            findings.append(
                Finding(
                    "units",
                    each.response,
                    f"{each.cause} over {each.response} is {length_m:.4g} m in {each.file}, "
                    f"expected a wheelbase, or that times a steering ratio: {words}? Correct unit "
                    f"or sign of {steer} or {yaw_rate} in the mapping",
                )
            )
    return findings


def _accelerations(episodes: Sequence[Episode], mapping: Mapping, schema: Schema) -> list[Finding]:
    speed, yaw_rate = mapping.name_of(Quantity.SPEED), mapping.name_of(Quantity.YAW_RATE)
    if speed is None or yaw_rate is None:
        return []
    lateral = np.concatenate(
        [column(e, schema, speed) * column(e, schema, yaw_rate) for e in episodes]
    )
    high = float(np.quantile(np.abs(lateral), 0.999))
    if high <= LARGEST_ACCELERATION_MPS2:
        return []
    return [
        Finding(
            "units",
            yaw_rate,
            f"{speed} times {yaw_rate} reaches {high:.3g} m/s^2, more than any vehicle: degrees "
            f"taken for radians, or km/h for m/s? Correct the units in the mapping",
        )
    ]


def known_factor(ratio: float) -> MixUp | None:
    """The mix-up that this ratio, or its inverse, is a sign of; None if it is of none."""
    if ratio <= 0.0:
        return None
    for mix_up in MIX_UPS:
        if abs(abs(log(ratio)) - log(mix_up.factor)) < log(1.0 + FACTOR_TOLERANCE):
            return mix_up
    return None
