"""The figures of a whole matrix: how many drives hold, and the largest value of each figure."""

from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.fault_matrix.verdict import DETECTED_WITHIN_MS, LANE_M, LONGEST_NOMINAL_S, MatrixRow


class MatrixSummary(NamedTuple):
    """The largest values are those of the drives whose fault has no `known_limit`."""

    drives: int
    drives_ok: int
    drives_known_limit: int  # not ok, with a `known_limit`
    drives_open: int  # not ok without one
    drives_detected: int  # within 0.5 s, ok or not
    drives_detected_late: int  # ok, since the fault is harmless, and detected after more than 0.5 s
    drives_harmless: int  # ok, with a fault that is harmless and was never detected
    drives_without_fault: int
    max_ey_m: float
    nominal_far_s: float
    state_loss_flagged_ms: float | None  # None: no such fault was driven, or it was not noticed
    state_loss_safe_stop_ms: float | None
    dead_controller_braking_ms: float | None


def summarise(rows: Sequence[MatrixRow]) -> MatrixSummary:
    """The summary of all rows."""
    judged = [row for row in rows if not row.known_limit]
    late = [row for row in rows if row.ok and not (row.is_fault_free or row.is_detected)]
    losses = [row for row in rows if row.fault in ("state_lost", "one_state_frame_lost")]
    silent = [row for row in rows if row.fault in ("controller_silent", "commands_lost")]
    return MatrixSummary(
        drives=len(rows),
        drives_ok=sum(row.ok for row in rows),
        drives_known_limit=sum(not row.ok and not row.is_open for row in rows),
        drives_open=sum(row.is_open for row in rows),
        drives_detected=sum(row.is_detected for row in rows),
        drives_detected_late=sum(row.detect_ms is not None for row in late),
        drives_harmless=sum(row.detect_ms is None for row in late),
        drives_without_fault=sum(row.is_fault_free for row in rows),
        max_ey_m=max((row.max_ey_m for row in judged), default=0.0),
        nominal_far_s=max((row.nominal_far_s for row in judged), default=0.0),
        state_loss_flagged_ms=_latest([row.detect_ms for row in losses]),
        state_loss_safe_stop_ms=_latest([row.safe_stop_ms for row in losses]),
        dead_controller_braking_ms=_latest([row.vehicle_braking_ms for row in silent]),
    )


def lines_of(found: MatrixSummary) -> list[str]:
    """The summary for a person, each figure with its limit."""
    lines = [
        f"{found.drives_ok} of {found.drives} drives are ok; not ok: {found.drives_known_limit} "
        f"with a known limit, {found.drives_open} others",
        f"detected within {1e-3 * DETECTED_WITHIN_MS:g} s: {found.drives_detected}; harmless and "
        f"detected later: {found.drives_detected_late}; harmless and not detected: "
        f"{found.drives_harmless}; without a fault: {found.drives_without_fault}",
        f"drives without a known limit: largest |e_y| {found.max_ey_m:.2f} m (limit {LANE_M:g} m), "
        f"longest normal driving at more than 1 m from the path {found.nominal_far_s:.2f} s "
        f"(limit {LONGEST_NOMINAL_S:g} s)",
    ]
    times = (
        ("lost state flagged", found.state_loss_flagged_ms, 50),
        ("lost state to safe stop", found.state_loss_safe_stop_ms, 125),
        ("dead controller to braking", found.dead_controller_braking_ms, 100),
    )
    known = [f"{name} {ms:.0f} ms (limit {most})" for name, ms, most in times if ms is not None]
    return [*lines, ", ".join(known)] if known else lines


def _latest(times_ms: Sequence[float | None]) -> float | None:
    """The largest; None if one is missing, or there is none."""
    known = [each for each in times_ms if each is not None]
    return max(known, default=None) if len(known) == len(times_ms) else None
