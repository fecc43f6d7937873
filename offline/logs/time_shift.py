"""Which signals come late, told by what moves them: cross-correlation of cause and response.

A logger that filters, or a signal that crossed a gateway, is stamped late. What the pose says of
heading and speed is the same as what yaw rate and speed say, so there any lag is the log's. A
car's own answer takes time too: between steering and yaw rate 0.05 to 0.15 s are its own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from offline.logs.episode import Episode
from offline.logs.finding import Finding
from offline.logs.log import Array
from offline.logs.mapping import Mapping
from offline.logs.pair import Tie, find_pairs
from rt_controller.contract.schema import Schema

LONGEST_S = 1.0
"""lag that is looked for, either way"""
LEAST_CORRELATION = 0.5
"""below, the two have too little to do with each other to tell"""


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
    own: Lag
    """what the car itself needs"""

    @property
    def is_expected(self) -> bool:
        return self.own.earliest_s <= self.lag_s <= self.own.latest_s


OWN_LAG = {
    Tie.STEERED: Lag(0.0, 0.1, 0.2),
    Tie.PEDALLED: Lag(-0.05, 0.1, 0.6),
    Tie.SAME: Lag(-0.05, 0.0, 0.05),
}
"""what the car itself needs"""


def find_time_shifts(
    episodes: Sequence[Episode], mapping: Mapping, schema: Schema
) -> list[TimeShift]:
    """The lag of every pair of cause and response that the logs have, where it can be told."""
    shifts = []
    for pair in find_pairs(episodes, mapping, schema):
        lag_s, correlation = correlate(pair.causes, pair.responses, schema.dt_s)
        if correlation >= LEAST_CORRELATION:
            own = OWN_LAG[pair.tie]
            shifts.append(TimeShift(pair.cause, pair.response, lag_s, correlation, own))
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
