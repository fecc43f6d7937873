"""What the logs of an import contradict: kinematics, a second record, each other, and the clock.

Relations that hold for every car are judged as in `signals check`. A car fixes the ratio of yaw
rate to speed times steering, and of the slope of the speed to a pedal: a log whose ratio is off by
3.6, 57.3, 9.81, 100 or 1000 compared with the others has a wrong unit. Two records of one motion
have no lag; yaw rate follows steering by 0.05 to 0.15 s.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from math import inf, isfinite, log, pi
from statistics import median_low
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.arrays import Array
from rt_controller.mapping import relations
from rt_controller.mapping.quantity import Quantity

UNIT_MISTAKES = {
    3.6: "km/h taken for m/s",
    180.0 / pi: "degrees taken for radians",
    9.80665: "g taken for m/s^2",
    100.0: "% taken for a ratio",
    1000.0: "a factor of a thousand",
}
"""units that are often confused, by the ratio of their numbers, which may be off by 12 %"""
LEAST_LAG_CORRELATION = 0.5
"""below, two signals are too unrelated for a lag"""
LONGEST_LAG_S = 1.0
"""largest lag that is searched, in both directions"""
Lag = tuple[float, float, float]
STEERING, PEDAL, SAME_MOTION = (0.0, 0.1, 0.2), (-0.05, 0.1, 0.6), (-0.05, 0.0, 0.05)
"""earliest, usual and latest lag in s that the car itself explains"""
LEAST_AGREEMENT = 0.74
"""of two records of one motion: a factor of 1.35 either way"""
_POSE_YAW_RATE, _POSE_SPEED, _GAINED = "slope of the pose's yaw", "speed of the pose", "slope of "
_OF_COURSE = " (a compass is sign = -1, offset = -90 in deg; or x and y are exchanged?)"
_SLOTS = {
    Quantity.SPEED: relations.VX,
    Quantity.LATERAL_SPEED: relations.VY,
    Quantity.YAW_RATE: relations.YAW_RATE,
}
Figures = dict[str, Any]


class Issue(NamedTuple):
    """Something in the logs that the user should look at before training."""

    check: str
    subject: str
    """signal or file"""
    message: str
    """what is unusual, and what to do about it"""


class Pair(NamedTuple):
    """Signals whose products depend on each other."""

    causes: tuple[str, ...]
    responses: tuple[str, ...]
    lag_s: Lag
    """of the response"""
    least_agreement: float = -inf
    without: str = ""
    """signal whose use is left out: the brake, which slows a car while its throttle still closes"""

    @property
    def relation(self) -> relations.Relation:
        """The cause is what is expected, the response what is found."""
        cause, response = map(" times ".join, (self.causes, self.responses))
        needs, windows = (*self.causes, *self.responses), partial(_integrals, self)
        text = f"{response} over {cause}"
        return relations.Relation(text, needs, windows, 0.0, self.least_agreement, "not related")


def _integrals(pair: Pair, signals: relations.Signals) -> tuple[Array, Array]:
    """Of cause and response while the car drives."""
    driving = 0.0 * signals.get(relations.VX, np.zeros(1))  # NaN of a slow car
    if pair.without in signals:
        driving = np.where(signals[pair.without] == 0.0, driving, np.nan)
    products = (np.prod([signals[name] for name in names], axis=0) for names in pair[:2])
    cause, response = (relations.integrals(each + driving, relations.SHORT) for each in products)
    return cause, response


def _pairs(mapping: LogMapping, names: Sequence[str]) -> list[Pair]:
    """The pairs of these tracks."""
    quantities = (Quantity.SPEED, Quantity.YAW_RATE, Quantity.STEERING)
    speed, yaw_rate, steer = (mapping.name_of(each) or "" for each in quantities)
    drive, brake = (mapping.name_of(each) or "" for each in (Quantity.DRIVE, Quantity.BRAKE))
    causes = (speed, steer) if speed else (steer,)
    pairs = [
        Pair(causes, (yaw_rate or _POSE_YAW_RATE,), STEERING),
        Pair((drive,), (_GAINED + speed,), PEDAL, without=brake),
        Pair((brake,), (_GAINED + speed,), PEDAL),
        Pair((_POSE_YAW_RATE,), (yaw_rate,), SAME_MOTION),
        Pair((_POSE_SPEED,), (speed,), SAME_MOTION),
    ]
    of_accelerometer = {
        Quantity.LONGITUDINAL_ACCELERATION: (_GAINED + speed,),
        Quantity.LATERAL_ACCELERATION: (speed, yaw_rate),
    }
    for name in mapping.checks.signals:
        quantity = mapping.quantity(name)
        same = of_accelerometer.get(quantity) or (mapping.name_of(quantity) or "",)
        pairs.append(Pair((name,), same, SAME_MOTION, LEAST_AGREEMENT))
    return [pair for pair in pairs if {*pair.causes, *pair.responses} <= {*names}]


def _tracks(episode: LogEpisode, mapping: LogMapping) -> dict[str, Array]:
    """Time and value (T, 2) by signal, by slot, and by name of what is computed from them."""
    t_s = episode.begin_s + mapping.period_s * np.arange(len(episode))
    known: dict[str, Array] = {
        name: values.to_numpy() * (-1.0 if mapping.quantity(name) is Quantity.BRAKE else 1.0)
        for name, values in episode.signals.items()
        if name in mapping.read_signals
    }
    slots = {slot: mapping.name_of(quantity) for quantity, slot in _SLOTS.items()}
    for slot in (relations.OFFSET, relations.HEADING, relations.CURVATURE, relations.WHEEL):
        slots[slot] = slot.partition(".")[2]
    known |= {slot: known[name] for slot, name in slots.items() if name in mapping.signals}
    if relations.VX in known:
        known[f"{_GAINED}{slots[relations.VX]}"] = np.gradient(known[relations.VX], t_s)
    if mapping.pose:
        slopes = np.gradient(episode.pose, t_s, axis=0)
        known[_POSE_SPEED] = np.hypot(slopes[:, 0], slopes[:, 1])
        known[_POSE_YAW_RATE] = slopes[:, 2]
        known |= zip((relations.X, relations.Y, relations.YAW), episode.pose.T, strict=True)
    return {name: np.column_stack((t_s, values)) for name, values in known.items()}


def compare_signals(
    episodes: Sequence[LogEpisode], mapping: LogMapping
) -> tuple[dict[str, dict[str, str]], list[Issue]]:
    """Whether each log contradicts each relation, and the issues of units and clocks.

    Ratios of two logs need a speed, to leave out the time in which the car stands.
    """
    parts: dict[str, list[dict[str, Array]]] = defaultdict(list)
    for episode in episodes:
        parts[episode.drive].append(_tracks(episode, mapping))
    logs = {
        file: {name: np.concatenate([part[name] for part in own]) for name in own[0]}
        for file, own in parts.items()
    }
    pairs = _pairs(mapping, tuple(logs[episodes[0].drive]))
    rows = relations.relations_of(mapping.car.car.geometry if mapping.car else None)
    rows += tuple(pair.relation for pair in pairs)
    found = {file: relations.check_relations(tracks, rows) for file, tracks in logs.items()}
    issues = [
        Issue(
            "units" if isfinite(each.factor) or text == relations.COURSE_OF_POSE else "relation",
            file,
            f"{text}: {each.answer.removeprefix('yes, ')}{_guess(each.factor)}"
            f"{_OF_COURSE if text == relations.COURSE_OF_POSE else ''}",
        )
        for file, of_log in found.items()
        for text, each in of_log.items()
        if each.is_contradicted
    ]
    signals = [relations.on_grid(tracks) for tracks in logs.values()]
    for pair in pairs:
        text = pair.relation.text
        if pair.lag_s != SAME_MOTION and mapping.name_of(Quantity.SPEED):
            issues += _unit_issues(text, {file: each[text].factor for file, each in found.items()})
        issues += _time_shift_issues(pair, [_integrals(pair, each) for each in signals])
    answers = {file: {t: each.answer for t, each in row.items()} for file, row in found.items()}
    return answers, issues


def _unit_issues(text: str, factors: Mapping[str, float]) -> Iterator[Issue]:
    """One issue for each log whose unit differs from that of the others."""
    known = {file: factor for file, factor in factors.items() if isfinite(factor) and factor}
    for file, factor in known.items():
        usual = median_low(known.values())
        if guess := _guess(factor / usual):
            message = (
                f"{text} is {factor:.4g}, in the other logs {usual:.4g}{guess}. All logs of one "
                f"import need the same units and signs; convert that one"
            )
            yield Issue("units", file, message)


def _guess(ratio: float) -> str:
    """What changes a number by this ratio: another sign, or a unit or its inverse."""
    if ratio < 0.0:
        return " (a wrong sign?)"
    for factor, words in UNIT_MISTAKES.items() if ratio > 0.0 else ():
        if abs(abs(log(ratio)) - log(factor)) < log(1.12):
            return f" ({words}?)"
    return ""


def _time_shift_issues(pair: Pair, series: Sequence[tuple[Array, Array]]) -> Iterator[Issue]:
    """An issue if the car does not explain the lag."""
    cause, response = pair.causes[-1], " times ".join(pair.responses)
    lag_s, correlation = correlate(series, relations.STEP_S)
    earliest_s, usual_s, latest_s = pair.lag_s
    if correlation >= LEAST_LAG_CORRELATION and not earliest_s <= lag_s <= latest_s:
        late = response if lag_s > latest_s else cause
        yield Issue(
            "time shift",
            late,
            f"{response} is {abs(lag_s):.2f} s {'behind' if lag_s > 0.0 else 'ahead of'} "
            f"{cause} (correlation {correlation:.2f}), expected {earliest_s:+.2f} to "
            f"{latest_s:+.2f} s. If the log is late and not the car, write delay_s, about "
            f"{abs(lag_s - usual_s):.2f}, for the column of {late}",
        )


def correlate(series: Sequence[tuple[Array, Array]], dt_s: float) -> tuple[float, float]:
    """Lag in s of responses after causes, and the correlation there, over all pairs of series.

    The correlation at each lag uses only the samples that overlap. The lag is refined between two
    periods by a parabola through the peak.
    """
    longest = round(LONGEST_LAG_S / dt_s)
    lags = range(-longest, longest + 1)
    # So many missing values between two parts that no lag mixes them.
    padded = [np.pad(each, ((0, 0), (0, longest)), constant_values=np.nan) for each in series]
    cause, response = (pd.Series(row) for row in np.concatenate(padded, axis=1))
    score = np.nan_to_num([cause.corr(response.shift(-lag)) for lag in lags])
    k = int(np.argmax(score))
    between = 0.0
    if 0 < k < len(lags) - 1:
        bend = score[k - 1] - 2.0 * score[k] + score[k + 1]
        between = 0.5 * (score[k - 1] - score[k + 1]) / bend if bend < 0.0 else 0.0
    return float((lags[k] + between) * dt_s), float(score[k])
