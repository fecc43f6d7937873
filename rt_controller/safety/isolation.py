"""Isolation: from the residuals of a tick to the signals that are no longer used.

Every relation between states contains several of them, so its residual shows that one of them is
faulty, but not which. Another relation decides: for progress or v_x the speed of the model, for yaw
rate or heading the lateral error, for v_y or the lateral error the v_y of the model.
"""

from collections.abc import Sequence
from enum import IntEnum
from functools import reduce
from operator import or_
from typing import NamedTuple

from rt_controller.contract.faults import StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.safety.checks import Check, Reaction

SignalMask = int
"""bits of `Faulty`"""


class Faulty(IntEnum):
    """Signals that are replaced by estimates for the rest of a stop: bits of a `SignalMask`."""

    NONE = 0
    SPEED = 1
    PROGRESS = 2
    LATERAL_SPEED = 4
    YAW_RATE = 8
    HEADING = 16
    LATERAL_ERROR = 32
    CURVATURE = 64
    PATH = 128
    PREVIEW = 256
    PLACE = HEADING | LATERAL_ERROR
    LATERAL_MOTION = LATERAL_SPEED | YAW_RATE
    MOTION = SPEED | LATERAL_MOTION
    STATE = SPEED | PROGRESS | LATERAL_SPEED | YAW_RATE | HEADING | LATERAL_ERROR


class Evidence(NamedTuple):
    """Residuals that isolate the faulty signal."""

    speed_error_mps: float
    """|v_x - expected|"""
    progress_error_mps: float
    """|Δs / period - expected|"""
    contradicts_lateral_speed: bool
    """the model predicted another v_y one or ten steps ago"""
    contradicts_yaw_rate: bool
    """the same of the yaw rate"""
    is_heading_jump: bool
    """the residual of the heading appeared within a period"""
    is_lateral_jump: bool
    """the same of the lateral error"""
    is_lateral_slow: bool
    """the residual of the lateral error grew slowly"""
    lateral_by_heading_m: float
    """|residual of e_y| with the e_psi that arrives"""
    lateral_by_yaw_rate_m: float
    """|residual of e_y| with the e_psi that is integrated from the yaw rate"""
    curvature_error_per_m: float
    """|curvature - first value of the curvature ahead|; 0 if that is not known"""
    estimated: SignalMask = Faulty.NONE
    """signals that are estimated already: they do not contradict measured ones"""


LATERAL_SPEED_DIFFERS_MPS, YAW_RATE_DIFFERS_RADPS = (0.14, 0.28), (0.02, 0.06)
"""from the predictions of one and of ten steps ago; above it this signal is the faulty one"""
LATERAL_SHARE = 0.7
"""of the residual of e_y; if the integrated heading explains more of it, the heading is faulty"""
CURVATURES_DIFFER_PER_M = 1e-3
CAUSES: dict[SignalMask, StopCause] = {
    Faulty.SPEED: StopCause.SPEED_IMPLAUSIBLE,
    Faulty.PROGRESS: StopCause.PROGRESS_IMPLAUSIBLE,
    Faulty.LATERAL_SPEED: StopCause.LATERAL_SPEED_IMPLAUSIBLE,
    Faulty.YAW_RATE: StopCause.YAW_RATE_IMPLAUSIBLE,
    Faulty.HEADING: StopCause.HEADING_IMPLAUSIBLE,
    Faulty.LATERAL_ERROR: StopCause.LATERAL_ERROR_IMPLAUSIBLE,
    Faulty.CURVATURE: StopCause.CURVATURE_IMPLAUSIBLE,
    Faulty.PATH: StopCause.PATH_INCONSISTENT,
    Faulty.STATE: StopCause.STATE_FROZEN,
}
_NAMED: dict[Quantity, SignalMask] = {
    Quantity.SPEED_STEP_MPS: Faulty.SPEED,
    Quantity.LATERAL_SPEED_STEP_MPS: Faulty.LATERAL_SPEED,
    Quantity.YAW_RATE_STEP_RADPS: Faulty.YAW_RATE,
    Quantity.CURVATURE_STEP_PER_M: Faulty.CURVATURE,
    Quantity.PEDAL_SPEED_MPS: Faulty.SPEED | Faulty.PROGRESS,
    Quantity.FROZEN_TICKS: Faulty.STATE,
}
"""quantities that depend on one signal only"""


def isolate(check: Check, evidence: Evidence) -> SignalMask:
    """The signal that is not used after this check has failed.

    NONE if another signal, an actuator or the grip explains the residual as well: the measured
    state is then kept.
    """
    quantity = check.quantity
    if quantity in _NAMED:
        return _NAMED[quantity]
    if quantity in (Quantity.PROGRESS_STEP_M, Quantity.PROGRESS_SPEED_MPS):
        is_speed = evidence.speed_error_mps > evidence.progress_error_mps
        return Faulty.SPEED if is_speed else Faulty.PROGRESS
    if quantity is Quantity.HEADING_RAD:
        return _of_heading(evidence)
    if quantity is Quantity.LATERAL_ERROR_M:
        return _of_lateral_error(evidence)
    return Faulty.NONE


def isolate_path(check: Check) -> SignalMask:
    """What is not used after a check of the path has failed; NONE: its speed alone."""
    if check.quantity is Quantity.PATH_SPEED_STEP_MPS:
        return Faulty.NONE
    return Faulty.PREVIEW if check.quantity is Quantity.PREVIEW_STEP_PER_M else Faulty.PATH


def is_jump(check: Check, evidence: Evidence) -> bool:
    """True if the residual of this integrated quantity appeared within a period."""
    if check.quantity is Quantity.HEADING_RAD:
        return evidence.is_heading_jump
    return evidence.is_lateral_jump


def _of_heading(evidence: Evidence) -> SignalMask:
    if evidence.is_heading_jump:
        return Faulty.HEADING
    if evidence.estimated & Faulty.YAW_RATE:
        return Faulty.YAW_RATE
    if evidence.contradicts_yaw_rate:
        return Faulty.YAW_RATE
    if evidence.curvature_error_per_m > CURVATURES_DIFFER_PER_M:
        return Faulty.CURVATURE
    if evidence.estimated & Faulty.LATERAL_ERROR:
        return Faulty.HEADING  # of the same sensor; an estimated e_y is no evidence
    is_heading = evidence.lateral_by_heading_m > evidence.lateral_by_yaw_rate_m
    return Faulty.HEADING if is_heading else Faulty.YAW_RATE


def _of_lateral_error(evidence: Evidence) -> SignalMask:
    """A slow drift is one of e_y or of v_y, and the model is not exact enough to tell which: the
    car stops with the state that it measures.
    """
    if evidence.is_lateral_jump:
        return Faulty.LATERAL_ERROR
    if evidence.lateral_by_yaw_rate_m < LATERAL_SHARE * evidence.lateral_by_heading_m:
        return Faulty.HEADING
    if evidence.estimated & Faulty.LATERAL_SPEED or evidence.contradicts_lateral_speed:
        return Faulty.LATERAL_SPEED
    return Faulty.NONE if evidence.is_lateral_slow else Faulty.LATERAL_ERROR


def cause_of(check: Check, faulty: SignalMask) -> StopCause:
    """The code of the stop."""
    if faulty in (Faulty.PATH, Faulty.PREVIEW):
        return check.cause
    return CAUSES.get(faulty, check.cause)


INTEGRATED = (Quantity.HEADING_RAD, Quantity.LATERAL_ERROR_M)
"""quantities whose residual may grow over several ticks"""


class Finding(NamedTuple):
    """Result of the failing checks of a tick."""

    faulty: SignalMask
    cause: StopCause
    is_stop: bool


class Windows:
    """Counts for how many ticks in a row each check has been above its threshold."""

    def __init__(
        self, values: list[float], checks: Sequence[Check], groups: Sequence[range]
    ) -> None:
        """`values` are compared, by `Quantity`; each group of quantities is compared at once."""
        self._values = values
        self._groups = {
            group: [(i, *check[1:4], check) for i, check in enumerate(checks) if check[1] in group]
            for group in groups
        }
        self._over = [0] * len(checks)
        self.failed: list[Check] = []
        """that `failing` has returned since this list was cleared"""

    def begin(self) -> None:
        """Set all counts to zero."""
        self._over = [0] * len(self._over)

    def failing(self, group: range) -> list[Check]:
        """The checks of a group that have been above their threshold for their window."""
        values, over = self._values, self._over
        found = []
        for i, quantity, threshold, window_ticks, check in self._groups[group]:
            if not values[quantity] > threshold:  # nor where it is not computed
                over[i] = 0
                continue
            over[i] += 1
            if over[i] >= window_ticks:
                found.append(check)
        self.failed += found
        return found


def finding_of(failing: Sequence[Check], signals: Sequence[SignalMask]) -> Finding:
    """One finding for several checks: all their signals, the cause of the first that names one."""
    both = list(zip(failing, signals, strict=True))
    check, faulty = next((pair for pair in both if pair[1]), both[0])
    return Finding(
        reduce(or_, signals),
        cause_of(check, faulty),
        any(each.reaction is Reaction.STOP for each in failing),
    )


def finding_of_state(failing: Sequence[Check], evidence: Evidence, is_repeated: bool) -> Finding:
    """The same for checks of the state, with the signals that are isolated by the evidence.

    Args:
        failing: at least one.
        evidence: of this tick.
        is_repeated: the last states are older ones that arrived again.
    """
    if is_repeated:
        return Finding(Faulty.STATE, StopCause.STATE_OLD, is_stop=True)
    found = finding_of(failing, [isolate(each, evidence) for each in failing])
    if any(each.quantity in INTEGRATED and not is_jump(each, evidence) for each in failing):
        found = found._replace(is_stop=True)  # it grew over several ticks: no outlier
    if found.faulty & Faulty.PLACE == Faulty.PLACE:
        found = found._replace(faulty=found.faulty | Faulty.STATE)  # no single signal
    return found
