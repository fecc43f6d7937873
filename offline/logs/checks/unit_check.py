"""Signals whose unit must be wrong, found from their ratio to other signals.

Speed, steering angle, yaw rate and pedals have ratios that the car fixes. A ratio that is off by
3.6, 57.3, 9.81, 100 or 1000 compared with the other logs means a wrong unit. Two measurements of
one motion (the pose, an accelerometer, a second speed) have the ratio 1.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median_low

import numpy as np

from offline.logs.checks.issue import Issue
from offline.logs.checks.pairs import Relation, find_pairs
from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.mapping.quantity import Quantity
from rt_controller.mapping.unit_mistakes import find_mistake

LEAST_CORRELATION = 0.8
"""below, two signals are too unrelated for a ratio"""
LARGEST_FACTOR = 1.35
"""between two measurements of one motion"""
LEAST_SPEED_MPS = 3.0
LARGEST_ACCELERATION_MPS2 = 45.0
"""of speed times yaw rate in all but one of a thousand samples: 4.5 g"""
TURNING_LENGTH_M = (1.0, 200.0)
"""range of speed times steering over yaw rate: the wheelbase, times the steering ratio if the angle
is that of the steering wheel, and more if the car understeers"""


_Suspicions = Iterator[tuple[str, str]]
"""subject and message of each issue"""


@dataclass(frozen=True, slots=True)
class Proportion:
    """Least-squares ratio of a response to its cause, in one log."""

    file: str
    relation: Relation
    cause: str
    response: str
    slope: float
    correlation: float

    @property
    def factor(self) -> float:
        """Ratio of the two without the effect of noise on the slope."""
        return self.slope / self.correlation

    @property
    def is_reliable(self) -> bool:
        """True if the two are related enough for a ratio."""
        return abs(self.correlation) >= LEAST_CORRELATION


def find_proportions(episodes: Sequence[LogEpisode], mapping: LogMapping) -> list[Proportion]:
    """The ratios in each log while its car drives; none without a speed."""
    speed = mapping.name_of(Quantity.SPEED)
    if speed is None:
        return []
    found = []
    for file in dict.fromkeys(episode.drive for episode in episodes):
        own = [episode for episode in episodes if episode.drive == file]
        is_driving = np.concatenate([e.signals[speed] >= LEAST_SPEED_MPS for e in own])
        for pair in find_pairs(own, mapping):
            c, r = (np.concatenate(each)[is_driving] for each in (pair.causes, pair.responses))
            power = float(c @ c * (r @ r))
            if power > 0.0:
                is_steering = pair.relation is Relation.STEERING
                cause = f"{speed} times {pair.cause}" if is_steering else pair.cause
                slope, correlation = float(c @ r / (c @ c)), float(c @ r) / power**0.5
                found.append(
                    Proportion(file, pair.relation, cause, pair.response, slope, correlation)
                )
    return found


def unit_issues(
    proportions: Sequence[Proportion], episodes: Sequence[LogEpisode], mapping: LogMapping
) -> list[Issue]:
    """One issue for each unit that is probably wrong."""
    reliable = [each for each in proportions if each.is_reliable]
    suspected = [
        *_between_files(reliable),
        *_same_motion(reliable),
        *_turning_length(reliable, mapping),
        *_accelerations(episodes, mapping),
    ]
    return [Issue("units", subject, message) for subject, message in suspected]


def _between_files(proportions: Sequence[Proportion]) -> _Suspicions:
    for pair in dict.fromkeys((each.cause, each.response) for each in proportions):
        same = [each for each in proportions if (each.cause, each.response) == pair]
        usual = median_low(each.slope for each in same)
        for each in same:
            mistake = find_mistake(each.slope / usual) if usual else None
            if mistake:
                yield (
                    each.file,
                    f"{each.response} over {each.cause} is {each.slope:.4g}, in the other logs "
                    f"{usual:.4g}: {mistake}? All logs of one import need the same units; convert "
                    f"that one",
                )


def _same_motion(proportions: Sequence[Proportion]) -> _Suspicions:
    same = [each for each in proportions if each.relation is Relation.SAME_MOTION]
    for each in same:
        if each.slope < 0.0:
            mistake: str | None = "a wrong sign"
        elif 1.0 / LARGEST_FACTOR <= abs(each.factor) <= LARGEST_FACTOR:
            continue
        else:
            mistake = find_mistake(each.slope) or "another unit, or another clock or period"
        yield (
            each.response,
            f"{each.slope:.4g} times the {each.cause} in {each.file}, expected 1: {mistake}? "
            f"Correct unit, sign or time in the mapping, of the one or of the other",
        )


def _turning_length(proportions: Sequence[Proportion], mapping: LogMapping) -> _Suspicions:
    steer, yaw_rate = mapping.name_of(Quantity.STEERING), mapping.name_of(Quantity.YAW_RATE)
    for each in proportions:
        if each.relation is not Relation.STEERING or each.response != yaw_rate:
            continue
        length_m = 1.0 / each.slope if each.slope else float("inf")
        if not TURNING_LENGTH_M[0] <= length_m <= TURNING_LENGTH_M[1]:
            yield (
                each.response,
                f"{each.cause} over {each.response} is {length_m:.4g} m in {each.file}, expected a "
                f"wheelbase, or that times a steering ratio: "
                f"{'a wrong sign' if length_m < 0.0 else 'degrees taken for radians'}? Correct "
                f"unit or sign of {steer} or {yaw_rate} in the mapping",
            )


def _accelerations(episodes: Sequence[LogEpisode], mapping: LogMapping) -> _Suspicions:
    speed, yaw_rate = mapping.name_of(Quantity.SPEED), mapping.name_of(Quantity.YAW_RATE)
    if speed is None or yaw_rate is None:
        return
    lateral = np.concatenate([e.signals[speed] * e.signals[yaw_rate] for e in episodes])
    high = float(np.quantile(np.abs(lateral), 0.999))
    if high > LARGEST_ACCELERATION_MPS2:
        yield (
            yaw_rate,
            f"{speed} times {yaw_rate} reaches {high:.3g} m/s^2, more than any vehicle: degrees "
            f"taken for radians, or km/h for m/s? Correct the units in the mapping",
        )
