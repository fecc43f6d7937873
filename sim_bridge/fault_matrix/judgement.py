"""When a drive with a fault counts as safe: the rules of the matrix, from the car's true motion."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_MS, PERIOD_S

DETECTED_WITHIN_S = 0.5
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

    mode: Mode | None
    """None: the controller has ended"""
    has_fault_bit: bool
    """in its heartbeat, or in the vehicle's STATE_C"""
    is_vehicle_braking: bool
    """the vehicle does not follow the commands"""
    is_driven: bool
    """False: the car waits for a controller"""
    is_faulty: bool
    """a fault acts"""
    ey_m: float
    """from the true path"""
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


class Judgement(NamedTuple):
    """One row of the matrix, without its fault and speed."""

    mode: str
    """of the controller at the end; ENDED: its program ended before"""
    detect_ms: float | None
    """from the first period with the fault; None: not detected"""
    max_ey_m: float
    nominal_far_s: float
    """longest time of normal driving beyond `HARMLESS_M`"""
    max_speed_error_mps: float
    """above the wanted speed, while the controller drove normally"""
    final_speed_mps: float
    safe_stop_ms: float | None
    """from the first period with the fault to the safe stop of the controller; None: no stop"""
    vehicle_braking_ms: float | None
    """the same to the braking of the vehicle by itself"""
    ok: bool
    reasons: tuple[str, ...]
    """why it is not ok"""


def judge(periods: Sequence[Observed], failure: str | None, is_fault_free: bool) -> Judgement:
    """The row of a drive; `failure` is the error that ended the vehicle's program."""
    first = next((k for k, each in enumerate(periods) if each.is_faulty), 0)
    after = periods[first:]
    found = _first(each.is_detected for each in after)
    last = periods[-1]
    max_ey_m = max(abs(each.ey_m) for each in periods)
    nominal = [each for each in periods if each.is_nominal and each.is_driven]
    overspeed = max((each.speed_mps - each.wanted_mps for each in nominal), default=0.0)
    far_s = PERIOD_S * _longest_run([e.is_nominal and abs(e.ey_m) > HARMLESS_M for e in periods])
    is_in_time = found is not None and found * PERIOD_S <= DETECTED_WITHIN_S
    is_harmless = max_ey_m <= HARMLESS_M and overspeed <= HARMLESS_MPS and last.is_driven
    is_over = last.is_nominal or last.speed_mps <= AT_REST_MPS or not last.is_driven
    reasons = [
        text
        for is_broken, text in (
            (failure is not None, failure or ""),
            (is_fault_free and found is not None, "a fault was reported without one"),
            (not is_fault_free and not (is_in_time or is_harmless), "not detected in time"),
            (max_ey_m > LANE_M, "left the lane"),
            (far_s > LONGEST_NOMINAL_S, "driven on far from the path"),
            (not is_over, "not brought to rest"),
        )
        if is_broken
    ]
    return Judgement(
        mode="ENDED" if last.mode is None else last.mode.name,
        detect_ms=_ms(found),
        max_ey_m=max_ey_m,
        nominal_far_s=far_s,
        max_speed_error_mps=overspeed,
        final_speed_mps=last.speed_mps,
        safe_stop_ms=_ms(_first(each.mode is Mode.SAFE_STOP for each in after)),
        vehicle_braking_ms=_ms(_first(each.is_vehicle_braking for each in after)),
        ok=not reasons,
        reasons=tuple(reasons),
    )


def _first(flags: Iterable[bool]) -> int | None:
    return next((k for k, flag in enumerate(flags) if flag), None)


def _ms(periods: int | None) -> float | None:
    return None if periods is None else periods * PERIOD_MS


def _longest_run(flags: Sequence[bool]) -> int:
    longest = run = 0
    for flag in flags:
        run = run + 1 if flag else 0
        longest = max(longest, run)
    return longest
