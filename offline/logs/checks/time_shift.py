"""Signals that are recorded late, found by cross-correlation of cause and response.

Yaw rate and speed of the pose and the signals of both are the same motion: a lag between them is a
delay of the log. The car itself has lags too: yaw rate follows steering by 0.05 to 0.15 s.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from offline.logs.checks.issue import Issue
from offline.logs.checks.pairs import Relation, find_pairs
from offline.logs.episode import LogEpisode
from offline.logs.mapping import LogMapping
from rt_controller.contract.arrays import Array

LONGEST_S = 1.0
"""largest lag that is searched, in both directions"""
LEAST_CORRELATION = 0.5
"""below, the two signals are too unrelated to estimate a lag"""


@dataclass(frozen=True, slots=True)
class LagRange:
    """Lag of a response that the car itself explains."""

    earliest_s: float
    usual_s: float
    latest_s: float


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


EXPECTED_LAG = {
    Relation.STEERING: LagRange(0.0, 0.1, 0.2),
    Relation.PEDAL: LagRange(-0.05, 0.1, 0.6),
    Relation.SAME_MOTION: LagRange(-0.05, 0.0, 0.05),
}


def find_time_shifts(episodes: Sequence[LogEpisode], mapping: LogMapping) -> list[TimeShift]:
    """The lag of every pair of signals that correlates enough to estimate it."""
    shifts = []
    for pair in find_pairs(episodes, mapping):
        lag_s, correlation = correlate(pair.causes, pair.responses, mapping.period_s)
        if correlation >= LEAST_CORRELATION:
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
    longest = round(LONGEST_S / dt_s)
    lags = range(-longest, longest + 1)
    cause, response = _join(causes, longest), _join(responses, longest)
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


def _join(parts: Sequence[Array], longest: int) -> pd.Series:
    """One series of all parts, with so many missing values between them that no lag mixes two."""
    return pd.Series(
        np.concatenate([np.pad(p, (0, longest), constant_values=np.nan) for p in parts])
    )
