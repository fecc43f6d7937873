"""One drive of the matrix and the rules by which it counts as safe, from the car's true motion."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import NamedTuple

from benchmarks.fault_matrix.cases import Case
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_MS, PERIOD_S
from sim_bridge.scenario.limits import KMH_PER_MPS

DETECTED_WITHIN_MS = 500.0
LANE_M = 1.75
"""largest distance from the true path, until the car stands"""
HARMLESS_M, HARMLESS_MPS = 1.0, 3.0
"""a fault that is not detected is harmless if neither path nor speed are missed by more"""
LARGEST_LOSS_M = 0.2
"""by which a drive may be farther from the path than the same drive without checks"""
LONGEST_NOMINAL_S = 0.3
"""that the controller may drive normally at more than `HARMLESS_M` from the path"""
AT_REST_MPS = 0.5


class Observed(NamedTuple):
    """One period: what the controller did, and where the car was, by the plant."""

    mode: Mode | None  # None: the controller has ended
    has_fault_bit: bool  # in its heartbeat, or in the vehicle's STATE_C
    is_vehicle_braking: bool  # the vehicle does not follow the commands
    is_driven: bool  # False: the car waits for a controller
    is_faulty: bool  # a fault acts
    ey_m: float  # from the true path
    speed_mps: float
    wanted_mps: float

    @property
    def is_detected(self) -> bool:
        """True if the controller or the vehicle shows that something is wrong."""
        is_waiting = self.mode is Mode.STANDBY and not self.is_driven
        is_normal = self.mode is not None and (self.mode.drives or is_waiting)
        return not is_normal or self.has_fault_bit or self.is_vehicle_braking

    @property
    def is_nominal(self) -> bool:
        """True if the controller drives normally."""
        return self.mode is not None and self.mode.drives and not self.is_vehicle_braking


class MatrixRow(NamedTuple):
    """One drive, as it is printed and written; the times count from the first faulty period."""

    fault: str
    speed_mps: float
    mode: str  # of the controller at the end; ENDED: its program ended before
    detect_ms: float | None  # None: not detected
    max_ey_m: float
    ok: bool
    nominal_far_s: float  # longest time of normal driving beyond `HARMLESS_M`
    max_speed_error_mps: float  # above the wanted speed, while the controller drove normally
    final_speed_mps: float
    safe_stop_ms: float | None  # to the safe stop of the controller; None: there was none
    vehicle_braking_ms: float | None  # to the braking of the vehicle by itself
    manoeuvre: str
    reasons: Sequence[str]  # why it is not ok
    known_limit: str  # why no reaction keeps the car on its lane; "" where one does
    is_fault_free: bool = False
    condition: str = ""  # of `conditions.toml`
    max_ey_unchecked_m: float | None = None
    """of the same drive without checks; None: not driven, `max_ey_m` is small"""

    @property
    def is_open(self) -> bool:
        """True of a drive that is not ok, and whose fault is not a documented limit."""
        return not self.ok and not self.known_limit

    @property
    def is_detected(self) -> bool:
        """True if the fault was detected in time."""
        return self.detect_ms is not None and self.detect_ms <= DETECTED_WITHIN_MS


def judge(
    case: Case,
    speed_kmh: float,
    periods: Sequence[Observed],
    failure: str | None = None,
    unchecked_m: float | None = None,
) -> MatrixRow:
    """The row of a drive.

    `failure` is the error that ended a program, `unchecked_m` the largest distance from the path in
    the same drive without checks.
    """
    first = next((k for k, each in enumerate(periods) if each.is_faulty), 0)
    after, last = periods[first:], periods[-1]
    detect_ms = _ms(each.is_detected for each in after)
    max_ey_m = max(abs(each.ey_m) for each in periods)
    overspeed = [p.speed_mps - p.wanted_mps for p in periods if p.is_nominal and p.is_driven]
    overspeed_mps = max(overspeed, default=0.0)
    is_far = (each.is_nominal and abs(each.ey_m) > HARMLESS_M for each in periods)
    far_s = PERIOD_S * max(len(list(run)) if far else 0 for far, run in groupby(is_far))
    is_in_time = detect_ms is not None and detect_ms <= DETECTED_WITHIN_MS
    is_harmless = max_ey_m <= HARMLESS_M and overspeed_mps <= HARMLESS_MPS and last.is_driven
    is_over = last.is_nominal or last.speed_mps <= AT_REST_MPS or not last.is_driven
    worse_m = 0.0 if unchecked_m is None else max_ey_m - unchecked_m
    rules = {
        failure or "": failure is not None,
        "a fault was reported without one": case.is_fault_free and detect_ms is not None,
        "not detected in time": not (case.is_fault_free or is_in_time or is_harmless),
        "left the lane": max_ey_m > LANE_M,
        "driven on far from the path": far_s > LONGEST_NOMINAL_S,
        "not brought to rest": not is_over,
        f"worse than without checks by {worse_m:.2f} m": worse_m > LARGEST_LOSS_M,
    }
    reasons = tuple(text for text, is_broken in rules.items() if is_broken)
    return MatrixRow(
        fault=case.name,
        speed_mps=round(speed_kmh / KMH_PER_MPS, 3),
        mode="ENDED" if last.mode is None else last.mode.name,
        detect_ms=detect_ms,
        max_ey_m=round(max_ey_m, 4),
        ok=not reasons,
        nominal_far_s=far_s,
        max_speed_error_mps=round(overspeed_mps, 3),
        final_speed_mps=round(last.speed_mps, 3),
        safe_stop_ms=_ms(each.mode is Mode.SAFE_STOP for each in after),
        vehicle_braking_ms=_ms(each.is_vehicle_braking for each in after),
        manoeuvre=case.manoeuvre,
        reasons=reasons,
        known_limit=case.known_limit,
        is_fault_free=case.is_fault_free,
        condition=case.condition,
        max_ey_unchecked_m=None if unchecked_m is None else round(unchecked_m, 4),
    )


def _ms(flags: Iterable[bool]) -> float | None:
    """Time to the first period with the flag; None: there is none."""
    return next((k * PERIOD_MS for k, flag in enumerate(flags) if flag), None)
