"""Pairs of signals that depend on each other, and what they tell about units and clocks.

The car fixes the ratio of yaw rate to speed times steering, and of the slope of the speed to a
pedal: a log whose ratio is off by 3.6, 57.3, 9.81, 100 or 1000 compared with the others has a wrong
unit. Two records of one motion (the pose, an accelerometer, a second speed) have the ratio 1 and no
lag; the car itself has lags: yaw rate follows steering by 0.05 to 0.15 s.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain
from statistics import median_low
from typing import NamedTuple

import numpy as np
import pandas as pd

from offline.logs.checks.samples import Issue, Range
from offline.logs.checks.unit_mistakes import find_mistake
from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.arrays import Array
from rt_controller.mapping.quantity import Quantity

LEAST_CORRELATION = 0.8
"""below, two signals are too unrelated for a ratio"""
LEAST_LAG_CORRELATION = 0.5
"""below, two signals are too unrelated for a lag"""
LONGEST_LAG_S = 1.0
"""largest lag that is searched, in both directions"""
LARGEST_FACTOR = 1.35
"""between two measurements of one motion"""
LEAST_SPEED_MPS = 3.0
LARGEST_ACCELERATION_MPS2 = 45.0
"""of speed times yaw rate in all but one of a thousand samples: 4.5 g"""
TURNING_LENGTH_M = (1.0, 200.0)
"""range of speed times steering over yaw rate: the wheelbase, times the steering ratio if the angle
is that of the steering wheel, and more if the car understeers"""
_SMOOTHING_S = 0.1
"""time over which derivatives are taken"""
_POSE_YAW_RATE, _POSE_SPEED = "slope of the pose's yaw", "speed of the pose"


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
    causes_name: str
    """the cause, or its product with the speed"""
    response: str
    causes: list[Array]
    """one (T,) for each episode"""
    responses: list[Array]


class LagRange(NamedTuple):
    """Lag of a response that the car itself explains, in s."""

    earliest_s: float
    usual_s: float
    latest_s: float


EXPECTED_LAG = {
    Relation.STEERING: LagRange(0.0, 0.1, 0.2),
    Relation.PEDAL: LagRange(-0.05, 0.1, 0.6),
    Relation.SAME_MOTION: LagRange(-0.05, 0.0, 0.05),
}


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
    def is_reliable(self) -> bool:
        """True if the two are related enough for a ratio."""
        return abs(self.correlation) >= LEAST_CORRELATION


@dataclass(frozen=True, slots=True)
class TimeShift:
    """Measured lag of a response behind its cause."""

    cause: str
    response: str
    lag_s: float
    """positive: the response comes later"""
    correlation: float
    """at that lag, 0 to 1"""
    expected: LagRange


def find_pairs(episodes: Sequence[LogEpisode], mapping: LogMapping) -> list[Pair]:
    """Every pair of the mapping's signals, its pose and its second measurements."""
    speed, yaw_rate, steer = _names(mapping)
    gained, turned = f"slope of {speed}", f"{speed} times {steer}" if speed else steer
    drive, brake = mapping.name_of(Quantity.DRIVE), mapping.name_of(Quantity.BRAKE)
    related = [
        (Relation.STEERING, steer, turned, yaw_rate),
        (Relation.PEDAL, drive, drive, gained),
        (Relation.PEDAL, brake, brake, gained),
        (Relation.STEERING, steer, turned, _POSE_YAW_RATE),
        (Relation.SAME_MOTION, _POSE_YAW_RATE, _POSE_YAW_RATE, yaw_rate),
        (Relation.SAME_MOTION, _POSE_SPEED, _POSE_SPEED, speed),
    ]
    of_accelerometer = {
        Quantity.LONGITUDINAL_ACCELERATION: gained,
        Quantity.LATERAL_ACCELERATION: f"{speed} times {yaw_rate}",
    }
    for name in mapping.checks.signals:
        quantity = mapping.quantity(name)
        same = of_accelerometer.get(quantity) or mapping.name_of(quantity)
        related.append((Relation.SAME_MOTION, name, name, same))
    motions = [_motion(episode, mapping) for episode in episodes]
    return [
        Pair(
            relation,
            cause,
            label,
            response,
            [m[label] for m in motions],
            [m[response] for m in motions],
        )
        for relation, cause, label, response in related
        if cause and label and response and {label, response} <= motions[0].keys()
    ]


def _names(mapping: LogMapping) -> tuple[str | None, ...]:
    """Signals of speed, yaw rate and steering."""
    return tuple(map(mapping.name_of, (Quantity.SPEED, Quantity.YAW_RATE, Quantity.STEERING)))


def _motion(episode: LogEpisode, mapping: LogMapping) -> dict[str, Array]:
    """The signals of an episode (T,) and what is computed from them and the pose, by name."""
    speed, yaw_rate, steer = _names(mapping)
    known: dict[str, Array] = {
        name: values.to_numpy() * (-1.0 if mapping.quantity(name) is Quantity.BRAKE else 1.0)
        for name, values in episode.signals.items()
        if name in mapping.read_signals
    }
    if speed:
        known[f"slope of {speed}"] = slope(known[speed], mapping.period_s)
        for other in filter(None, (steer, yaw_rate)):
            known[f"{speed} times {other}"] = known[speed] * known[other]
    if mapping.pose:
        vx, vy, known[_POSE_YAW_RATE] = (slope(p, mapping.period_s) for p in episode.pose.T)
        known[_POSE_SPEED] = np.hypot(vx, vy)
    return known


def slope(values: Array, dt_s: float) -> Array:
    """Derivative (T,), from differences over a tenth of a second around each sample."""
    reach = max(1, round(0.5 * _SMOOTHING_S / dt_s))
    inner = (values[2 * reach :] - values[: -2 * reach]) / (2 * reach * dt_s)
    return np.concatenate([np.repeat(inner[:1], reach), inner, np.repeat(inner[-1:], reach)])


def find_proportions(episodes: Sequence[LogEpisode], mapping: LogMapping) -> list[Proportion]:
    """The ratios in each log while its car drives; none without a speed."""
    speed = mapping.name_of(Quantity.SPEED)
    found = []
    for file in dict.fromkeys(episode.drive for episode in episodes) if speed else ():
        own = [episode for episode in episodes if episode.drive == file]
        is_driving = np.concatenate([e.signals[speed] >= LEAST_SPEED_MPS for e in own])
        for pair in find_pairs(own, mapping):
            c, r = (np.concatenate(each)[is_driving] for each in (pair.causes, pair.responses))
            power = float(c @ c * (r @ r))
            if power > 0.0:
                ratio, correlation = float(c @ r / (c @ c)), float(c @ r) / power**0.5
                names = (pair.causes_name, pair.response)
                found.append(Proportion(file, pair.relation, *names, ratio, correlation))
    return found


def unit_issues(
    proportions: Sequence[Proportion], episodes: Sequence[LogEpisode], mapping: LogMapping
) -> list[Issue]:
    """One issue for each unit that is probably wrong."""
    reliable = [each for each in proportions if each.is_reliable]
    suspected = (_between_files(reliable), _same_motion(reliable))
    impossible = _impossible_motion(reliable, episodes, mapping)
    return [Issue("units", *each) for each in chain(*suspected, impossible)]


def find_unchecked(
    mapping: LogMapping, proportions: Sequence[Proportion], ranges: Sequence[Range]
) -> tuple[str, ...]:
    """What no second measurement confirms: units, with the ranges, and the period of the rows."""
    same = [p for p in proportions if p.relation is Relation.SAME_MOTION and p.is_reliable]
    clocks = [column.time or mapping.time for column in mapping.every_column]
    has_rows_only = mapping.can is None and any(not (c.column or c.file) for c in clocks)
    return (
        *(("period of the rows",) if has_rows_only and not same else ()),
        *(
            f"unit of {each.name} ({each.lowest:.4g} to {each.highest:.4g} {each.unit})"
            for each in ranges
            if each.name in mapping.signals and not any(each.name in p.response for p in same)
        ),
    )


def _between_files(proportions: Sequence[Proportion]) -> Iterator[tuple[str, str]]:
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


def _same_motion(proportions: Sequence[Proportion]) -> Iterator[tuple[str, str]]:
    for each in (p for p in proportions if p.relation is Relation.SAME_MOTION):
        factor = abs(each.slope / each.correlation)  # without the effect of noise on the slope
        if each.slope < 0.0:
            mistake: str | None = "a wrong sign"
        elif 1.0 / LARGEST_FACTOR <= factor <= LARGEST_FACTOR:
            continue
        else:
            mistake = find_mistake(each.slope) or "another unit, or another clock or period"
        yield (
            each.response,
            f"{each.slope:.4g} times the {each.cause} in {each.file}, expected 1: {mistake}? "
            f"Correct unit, sign or time in the mapping, of the one or of the other",
        )


def _impossible_motion(
    proportions: Sequence[Proportion], episodes: Sequence[LogEpisode], mapping: LogMapping
) -> Iterator[tuple[str, str]]:
    """Wheelbases and lateral accelerations that no vehicle has."""
    speed, yaw_rate, steer = _names(mapping)
    if speed is None or yaw_rate is None:
        return
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
    lateral = np.concatenate([e.signals[speed] * e.signals[yaw_rate] for e in episodes])
    high = float(np.quantile(np.abs(lateral), 0.999))
    if high > LARGEST_ACCELERATION_MPS2:
        yield (
            yaw_rate,
            f"{speed} times {yaw_rate} reaches {high:.3g} m/s^2, more than any vehicle: degrees "
            f"taken for radians, or km/h for m/s? Correct the units in the mapping",
        )


def find_time_shifts(episodes: Sequence[LogEpisode], mapping: LogMapping) -> list[TimeShift]:
    """The lag of every pair of signals that correlates enough to estimate it."""
    shifts = []
    for pair in find_pairs(episodes, mapping):
        lag_s, correlation = correlate(pair.causes, pair.responses, mapping.period_s)
        if correlation >= LEAST_LAG_CORRELATION:
            expected = EXPECTED_LAG[pair.relation]
            shifts.append(TimeShift(pair.cause, pair.response, lag_s, correlation, expected))
    return shifts


def correlate(
    causes: Sequence[Array], responses: Sequence[Array], dt_s: float
) -> tuple[float, float]:
    """Lag of the responses in s and the correlation there, over all pairs of series.

    The correlation at each lag uses only the samples that overlap. The lag is refined between two
    periods by a parabola through the peak.
    """
    longest = round(LONGEST_LAG_S / dt_s)
    lags = range(-longest, longest + 1)
    # So many missing values between two parts that no lag mixes them.
    cause, response = (
        pd.Series(np.concatenate([np.pad(p, (0, longest), constant_values=np.nan) for p in parts]))
        for parts in (causes, responses)
    )
    score = np.nan_to_num([cause.corr(response.shift(-lag)) for lag in lags])
    k = int(np.argmax(score))
    between = 0.0
    if 0 < k < len(lags) - 1:
        bend = score[k - 1] - 2.0 * score[k] + score[k + 1]
        between = 0.5 * (score[k - 1] - score[k + 1]) / bend if bend < 0.0 else 0.0
    return float((lags[k] + between) * dt_s), float(score[k])


def time_shift_issues(shifts: Sequence[TimeShift]) -> Iterator[Issue]:
    """One issue for each lag that the car does not explain."""
    for shift in shifts:
        expected = shift.expected
        if expected.earliest_s <= shift.lag_s <= expected.latest_s:
            continue
        late = shift.response if shift.lag_s > expected.latest_s else shift.cause
        order = "behind" if shift.lag_s > 0.0 else "ahead of"
        yield Issue(
            "time shift",
            late,
            f"{shift.response} is {abs(shift.lag_s):.2f} s {order} {shift.cause} (correlation "
            f"{shift.correlation:.2f}), expected {expected.earliest_s:+.2f} to "
            f"{expected.latest_s:+.2f} s. If the log is late and not the car, write delay_s, about "
            f"{abs(shift.lag_s - expected.usual_s):.2f}, for the column of {late}",
        )
