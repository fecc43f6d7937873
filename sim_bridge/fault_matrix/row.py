"""One drive of the matrix, as it is printed and written."""

from dataclasses import dataclass

from sim_bridge.fault_matrix.cases import Case
from sim_bridge.fault_matrix.judgement import LARGEST_LOSS_M, Judgement
from sim_bridge.scenario.limits import KMH_PER_MPS


@dataclass(frozen=True, slots=True)
class MatrixRow:
    """One drive of the matrix."""

    fault: str
    speed_mps: float
    mode: str
    detect_ms: float | None
    max_ey_m: float
    ok: bool
    nominal_far_s: float
    max_speed_error_mps: float
    final_speed_mps: float
    safe_stop_ms: float | None
    """to the safe stop of the controller; None: there was none"""
    vehicle_braking_ms: float | None
    """to the braking of the vehicle by itself"""
    manoeuvre: str
    reasons: tuple[str, ...]
    known_limit: str
    """why no reaction keeps the car on its lane; "" where one does"""
    is_fault_free: bool = False
    """the drive without a fault"""
    condition: str = ""
    """of `conditions.toml`"""
    max_ey_unchecked_m: float | None = None
    """of the same drive without checks; None: not driven, `max_ey_m` is small"""

    @property
    def is_open(self) -> bool:
        """True of a drive that is not ok, and whose fault is not a documented limit."""
        return not self.ok and not self.known_limit


def row_of(
    case: Case, speed_kmh: float, found: Judgement, max_ey_unchecked_m: float | None = None
) -> MatrixRow:
    """The row of a drive that was judged, beside the same drive without checks."""
    if max_ey_unchecked_m is not None:
        worse_m = found.max_ey_m - max_ey_unchecked_m
        if worse_m > LARGEST_LOSS_M:
            reason = f"worse than without checks by {worse_m:.2f} m"
            found = found._replace(ok=False, reasons=(*found.reasons, reason))
    return MatrixRow(
        fault=case.name,
        speed_mps=round(speed_kmh / KMH_PER_MPS, 3),
        mode=found.mode,
        detect_ms=found.detect_ms,
        max_ey_m=round(found.max_ey_m, 4),
        ok=found.ok,
        nominal_far_s=found.nominal_far_s,
        max_speed_error_mps=round(found.max_speed_error_mps, 3),
        final_speed_mps=round(found.final_speed_mps, 3),
        safe_stop_ms=found.safe_stop_ms,
        vehicle_braking_ms=found.vehicle_braking_ms,
        manoeuvre=case.manoeuvre,
        reasons=found.reasons,
        known_limit=case.known_limit,
        is_fault_free=case.is_fault_free,
        condition=case.condition,
        max_ey_unchecked_m=None if max_ey_unchecked_m is None else round(max_ey_unchecked_m, 4),
    )
