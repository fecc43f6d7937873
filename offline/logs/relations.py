"""Pairs of signals that depend on each other, and what they tell about units and clocks.

The car fixes the ratio of yaw rate to speed times steering, and of the slope of the speed to a
pedal: a log whose ratio is off by 3.6, 57.3, 9.81, 100 or 1000 compared with the others has a wrong
unit, one whose ratio is negative a wrong sign. Two records of one motion (the pose, an
accelerometer, a second speed) have the ratio 1 and no lag; the car itself has lags: yaw rate
follows steering by 0.05 to 0.15 s.
"""

from collections.abc import Iterator, Sequence
from math import log, pi
from statistics import median_low
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.arrays import Array
from rt_controller.mapping.quantity import Quantity

FACTOR_TOLERANCE = 0.12
"""relative difference between a ratio and a known factor that still counts as that factor"""
UNIT_MISTAKES = {
    3.6: "km/h taken for m/s",
    180.0 / pi: "degrees taken for radians",
    9.80665: "g taken for m/s^2",
    100.0: "% taken for a ratio",
    1000.0: "a factor of a thousand",
}
"""units that are often confused, by the ratio of their numbers"""
LEAST_CORRELATION = 0.8
"""below, two signals are too unrelated for a ratio"""
LEAST_LAG_CORRELATION = 0.5
"""below, two signals are too unrelated for a lag"""
LONGEST_LAG_S = 1.0
"""largest lag that is searched, in both directions"""
LARGEST_FACTOR = 1.35
"""between two measurements of one motion"""
LEAST_SPEED_MPS = 3.0
EXPECTED_LAG_S = {
    "steering": (0.0, 0.1, 0.2),
    "pedal": (-0.05, 0.1, 0.6),
    "same motion": (-0.05, 0.0, 0.05),
}
"""earliest, usual and latest lag that the car itself explains, by the relation of two signals: yaw
rate to steering times speed; slope of the speed to a pedal (the sign of a brake reversed); a
quantity computed from the pose, or measured twice, to the signal of the same quantity"""
_SMOOTHING_S = 0.1
"""time over which derivatives are taken"""
_POSE_YAW_RATE, _POSE_SPEED = "slope of the pose's yaw", "speed of the pose"
_MOTION = (Quantity.SPEED, Quantity.YAW_RATE, Quantity.STEERING)
_PEDALS = (Quantity.DRIVE, Quantity.BRAKE)
Figures = dict[str, Any]


class Issue(NamedTuple):
    """Something in the logs that the user should look at before training."""

    check: str
    subject: str
    """signal or file"""
    message: str
    """what is unusual, and what to do about it"""


def _pairs(mapping: LogMapping) -> Iterator[tuple[str, str, str, str]]:
    """Relation, cause, the cause or its product with the speed, and response."""
    speed, yaw_rate, steer = map(mapping.name_of, _MOTION)
    gained, turned = f"slope of {speed}", f"{speed} times {steer}" if speed else steer
    related = [
        ("steering", steer, turned, yaw_rate),
        *(("pedal", pedal, pedal, gained) for pedal in map(mapping.name_of, _PEDALS)),
        ("steering", steer, turned, _POSE_YAW_RATE),
        ("same motion", _POSE_YAW_RATE, _POSE_YAW_RATE, yaw_rate),
        ("same motion", _POSE_SPEED, _POSE_SPEED, speed),
    ]
    of_accelerometer = {
        Quantity.LONGITUDINAL_ACCELERATION: gained,
        Quantity.LATERAL_ACCELERATION: f"{speed} times {yaw_rate}",
    }
    for name in mapping.checks.signals:
        quantity = mapping.quantity(name)
        same = of_accelerometer.get(quantity) or mapping.name_of(quantity)
        related.append(("same motion", name, name, same))
    for relation, cause, label, response in related:
        if cause and label and response:
            yield relation, cause, label, response


def _motion(episode: LogEpisode, mapping: LogMapping) -> dict[str, Array]:
    """The signals of an episode (T,) and what is computed from them and the pose, by name."""
    speed, yaw_rate, steer = map(mapping.name_of, _MOTION)
    known: dict[str, Array] = {
        name: values.to_numpy() * (-1.0 if mapping.quantity(name) is Quantity.BRAKE else 1.0)
        for name, values in episode.signals.items()
        if name in mapping.read_signals
    }
    if speed:
        known[f"slope of {speed}"] = _slope(known[speed], mapping.period_s)
        for other in filter(None, (steer, yaw_rate)):
            known[f"{speed} times {other}"] = known[speed] * known[other]
    if mapping.pose:
        vx, vy, known[_POSE_YAW_RATE] = (_slope(p, mapping.period_s) for p in episode.pose.T)
        known[_POSE_SPEED] = np.hypot(vx, vy)
    return known


def _slope(values: Array, dt_s: float) -> Array:
    """Derivative (T,), from differences over a tenth of a second around each sample."""
    reach = max(1, round(0.5 * _SMOOTHING_S / dt_s))
    inner = (values[2 * reach :] - values[: -2 * reach]) / (2 * reach * dt_s)
    return np.pad(inner, reach, mode="edge")


def find_relations(
    episodes: Sequence[LogEpisode], mapping: LogMapping
) -> tuple[list[Figures], list[Figures]]:
    """Least-squares ratios of dependent signals in each log, and their lags over all logs.

    A ratio needs a speed, to leave out the time in which the car stands. A positive lag means that
    the response comes later.
    """
    motions, speed = [_motion(e, mapping) for e in episodes], mapping.name_of(Quantity.SPEED)
    pairs = [p for p in _pairs(mapping) if {p[2], p[3]} <= motions[0].keys()]
    ratios, lags = [], []
    for file in dict.fromkeys(episode.drive for episode in episodes) if speed else ():
        own = [m for m, e in zip(motions, episodes, strict=True) if e.drive == file]
        whole = {name: np.concatenate([m[name] for m in own]) for name in own[0]}
        is_driving = whole[speed or ""] >= LEAST_SPEED_MPS
        for relation, _, cause, response in pairs:
            c, r = whole[cause][is_driving], whole[response][is_driving]
            power = float(c @ c * (r @ r))
            if power > 0.0:
                found = {"slope": float(c @ r / (c @ c)), "correlation": float(c @ r) / power**0.5}
                names = {"file": file, "relation": relation, "cause": cause, "response": response}
                ratios.append(names | found)
    for relation, cause, label, response in pairs:
        causes, responses = ([m[name] for m in motions] for name in (label, response))
        lag_s, correlation = correlate(causes, responses, mapping.period_s)
        if correlation >= LEAST_LAG_CORRELATION:
            found = {"lag_s": lag_s, "correlation": correlation}
            expected = {"expected": EXPECTED_LAG_S[relation]}
            lags.append({"cause": cause, "response": response} | found | expected)
    return ratios, lags


def _is_reliable(ratio: Figures) -> bool:
    return bool(abs(ratio["correlation"]) >= LEAST_CORRELATION)


def unit_issues(ratios: Sequence[Figures]) -> Iterator[Issue]:
    """One issue for each unit that differs between logs, or from a second record of the motion."""
    columns = ["file", "relation", "cause", "response", "slope", "correlation"]
    reliable = pd.DataFrame(filter(_is_reliable, ratios), columns=columns)
    for (cause, response), alike in reliable.groupby(["cause", "response"], sort=False):
        usual = median_low(alike["slope"])
        for each in alike.itertuples() if usual else ():
            if mistake := _find_mistake(each.slope / usual):
                yield Issue(
                    "units",
                    each.file,
                    f"{response} over {cause} is {each.slope:.4g}, in the other logs {usual:.4g}: "
                    f"{mistake}? All logs of one import need the same units and signs; convert "
                    f"that one",
                )
    for each in reliable[reliable["relation"] == "same motion"].itertuples():
        factor = abs(each.slope / each.correlation)  # without the effect of noise on the slope
        if each.slope < 0.0 or not 1.0 / LARGEST_FACTOR <= factor <= LARGEST_FACTOR:
            mistake = _find_mistake(each.slope) or "another unit, or another clock or period"
            yield Issue(
                "units",
                each.response,
                f"{each.slope:.4g} times the {each.cause} in {each.file}, expected 1: "
                f"{mistake}? Correct unit, sign or time in the mapping, of the one or of the other",
            )


def _find_mistake(ratio: float) -> str | None:
    """What changes a number by this ratio: another sign, or a unit or its inverse; else None."""
    if ratio < 0.0:
        return "a wrong sign"
    for factor, words in UNIT_MISTAKES.items() if ratio else ():
        if abs(abs(log(ratio)) - log(factor)) < log(1.0 + FACTOR_TOLERANCE):
            return words
    return None


def find_unchecked(
    mapping: LogMapping, ratios: Sequence[Figures], ranges: Sequence[Figures]
) -> list[str]:
    """What no second measurement confirms: units, with the ranges, and the period of the rows."""
    same = [r["response"] for r in ratios if r["relation"] == "same motion" and _is_reliable(r)]
    clocks = [column.time or mapping.time for column in mapping.every_column]
    has_rows_only = mapping.can is None and any(not (c.column or c.file) for c in clocks)
    return [
        *(["period of the rows"] if has_rows_only and not same else []),
        *(
            f"unit of {each['name']} ({each['lowest']:.4g} to {each['highest']:.4g} {each['unit']})"
            for each in ranges
            if each["name"] in mapping.signals and not any(each["name"] in name for name in same)
        ),
    ]


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


def time_shift_issues(lags: Sequence[Figures]) -> Iterator[Issue]:
    """One issue for each lag that the car does not explain."""
    for each in lags:
        cause, response, lag_s = each["cause"], each["response"], each["lag_s"]
        earliest_s, usual_s, latest_s = each["expected"]
        if not earliest_s <= lag_s <= latest_s:
            late = response if lag_s > latest_s else cause
            yield Issue(
                "time shift",
                late,
                f"{response} is {abs(lag_s):.2f} s {'behind' if lag_s > 0.0 else 'ahead of'} "
                f"{cause} (correlation {each['correlation']:.2f}), expected {earliest_s:+.2f} to "
                f"{latest_s:+.2f} s. If the log is late and not the car, write delay_s, about "
                f"{abs(lag_s - usual_s):.2f}, for the column of {late}",
            )
