"""Which signals come late, told by what moves them: cross-correlation of cause and response.

A logger that filters, or a signal that crossed a gateway, is stamped late. What the pose says of
heading and speed is the same as what yaw rate and speed say, so there any lag is the log's. A
car's own answer takes time too: between steering and yaw rate 0.05 to 0.15 s are its own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.logs.episode import Episode, column
from offline.logs.finding import Finding
from offline.logs.log import Array
from offline.logs.mapping import Mapping
from offline.logs.quantity import Quantity
from rt_controller.contract.schema import Schema

LONGEST_S = 1.0
"""lag that is looked for, either way"""
LEAST_CORRELATION = 0.5
"""below, the two have too little to do with each other to tell"""
_SMOOTHING_S = 0.1
"""over which derivatives are taken"""


class Lag(NamedTuple):
    """By how much a response may lie behind its cause."""

    earliest_s: float
    usual_s: float
    latest_s: float


class TimeShift(NamedTuple):
    """How late a response is behind its cause."""

    cause: str
    response: str
    lag_s: float
    """positive: the response comes later"""
    correlation: float
    """at that lag, 0 to 1"""
    own: "Lag"
    """what the car itself needs"""

    @property
    def is_expected(self) -> bool:
        return self.own.earliest_s <= self.lag_s <= self.own.latest_s


STEERED = Lag(0.0, 0.1, 0.2)
PEDALLED = Lag(-0.05, 0.1, 0.6)
SAME = Lag(-0.05, 0.0, 0.05)
"""two measurements of one thing"""


class _Pair(NamedTuple):
    cause: str
    response: str
    causes: list[Array]
    responses: list[Array]
    own: Lag


def find_time_shifts(
    episodes: Sequence[Episode], mapping: Mapping, schema: Schema
) -> list[TimeShift]:
    """The lag of every pair of cause and response that the logs have, where it can be told."""
    shifts = []
    for pair in _pairs(episodes, mapping, schema):
        lag_s, correlation = correlate(pair.causes, pair.responses, schema.dt_s)
        if correlation >= LEAST_CORRELATION:
            shifts.append(TimeShift(pair.cause, pair.response, lag_s, correlation, pair.own))
    return shifts


def correlate(
    causes: Sequence[Array], responses: Sequence[Array], dt_s: float
) -> tuple[float, float]:
    """Lag of the responses in s and the correlation there, over all pairs of series.

    The lag lies between two periods where the correlation does: a parabola through its peak.
    """
    longest = round(LONGEST_S / dt_s)
    lags = range(-longest, longest + 1)
    # n, c, r, c c, r r, c r: the means are those of each lag's own samples, so that a copy
    # correlates by exactly 1 at its lag, however it drifts.
    sums = np.zeros((len(lags), 6))
    for cause, response in zip(causes, responses, strict=True):
        for i, lag in enumerate(lags):
            c = cause[max(0, -lag) : len(cause) - max(0, lag)]
            r = response[max(0, lag) : len(response) - max(0, -lag)]
            sums[i] += len(c), c.sum(), r.sum(), c @ c, r @ r, c @ r
    n, c_sum, r_sum, cc, rr, cr = sums.T
    power = (cc - c_sum**2 / n) * (rr - r_sum**2 / n)
    scale = np.sqrt(np.maximum(power, 0.0))
    score = np.where(scale > 0.0, (cr - c_sum * r_sum / n) / np.where(scale > 0.0, scale, 1.0), 0.0)
    k = int(np.argmax(score))
    between = 0.0
    if 0 < k < len(lags) - 1:
        bend = score[k - 1] - 2.0 * score[k] + score[k + 1]
        between = 0.5 * (score[k - 1] - score[k + 1]) / bend if bend < 0.0 else 0.0
    return float((lags[k] + between) * dt_s), float(score[k])


def remarks(shifts: Sequence[TimeShift]) -> list[Finding]:
    """One finding for each lag that a car does not explain."""
    findings = []
    for shift in shifts:
        if shift.is_expected:
            continue
        own = shift.own
        is_late = shift.lag_s > own.latest_s
        late = shift.response if is_late else shift.cause
        by_s = abs(shift.lag_s - own.usual_s)
        order = "behind" if shift.lag_s > 0.0 else "ahead of"
        findings.append(
            Finding(
                "time shift",
                late,
                f"{shift.response} is {abs(shift.lag_s):.2f} s {order} {shift.cause} (correlation "
                f"{shift.correlation:.2f}), expected {own.earliest_s:+.2f} to "
                f"{own.latest_s:+.2f} s. If the log is late and not the car, write delay_s, about "
                f"{by_s:.2f}, for what {late} comes from",
            )
        )
    return findings


def _pairs(episodes: Sequence[Episode], mapping: Mapping, schema: Schema) -> list[_Pair]:
    speed = mapping.name_of(Quantity.SPEED)
    yaw_rate = mapping.name_of(Quantity.YAW_RATE)
    steer = mapping.name_of(Quantity.STEERING)
    dt_s = schema.dt_s
    pairs = []

    def signals(name: str) -> list[Array]:
        return [column(episode, schema, name) for episode in episodes]

    turned: list[Array] = []
    if steer is not None:
        ways = signals(speed) if speed else [np.ones(len(e.x)) for e in episodes]
        turned = [way * angle for way, angle in zip(ways, signals(steer), strict=True)]
    if steer and yaw_rate:
        pairs.append(_Pair(steer, yaw_rate, turned, signals(yaw_rate), STEERED))
    if speed:
        gained = [slope(values, dt_s) for values in signals(speed)]
        name = f"slope of {speed}"
        for quantity, sign in ((Quantity.DRIVE, 1.0), (Quantity.BRAKE, -1.0)):
            pedal = mapping.name_of(quantity)
            if pedal:
                pressed = [sign * values for values in signals(pedal)]
                pairs.append(_Pair(pedal, name, pressed, gained, PEDALLED))
    if mapping.pose:
        heading = [slope(e.pose[:, 2], dt_s) for e in episodes]
        if steer:
            pairs.append(_Pair(steer, "slope of the pose's yaw", turned, heading, STEERED))
        if yaw_rate:
            turning = signals(yaw_rate)
            pairs.append(_Pair("slope of the pose's yaw", yaw_rate, heading, turning, SAME))
        if speed:
            moved = [np.hypot(*(slope(e.pose[:, i], dt_s) for i in (0, 1))) for e in episodes]
            pairs.append(_Pair("speed of the pose", speed, moved, signals(speed), SAME))
    return pairs


def slope(values: Array, dt_s: float) -> Array:
    """Derivative (T,), from differences over a tenth of a second around each sample."""
    reach = max(1, round(0.5 * _SMOOTHING_S / dt_s))
    inner = (values[2 * reach :] - values[: -2 * reach]) / (2 * reach * dt_s)
    return np.concatenate([np.repeat(inner[:1], reach), inner, np.repeat(inner[-1:], reach)])
