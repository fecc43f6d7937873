"""Tracking errors of a run: running sums over the driven ticks, in constant memory."""

from math import atan, sqrt
from typing import NamedTuple

from rt_controller.contract.signals import PathReference, VehicleState


class TrackingErrors(NamedTuple):
    """Deviations of the car from its reference over a run."""

    ey_rms_m: float
    ey_peak_m: float
    epsi_rms_rad: float
    epsi_peak_rad: float
    vx_rms_mps: float
    vx_peak_mps: float


class TrackingAccount:
    """Sums of squares and peaks of the tracking errors, one tick at a time."""

    def __init__(self) -> None:
        self._squares = [0.0, 0.0, 0.0]
        self._peaks = [0.0, 0.0, 0.0]
        self.ticks = 0

    def record(self, state: VehicleState, path: PathReference) -> None:
        """Add one tick; the reference is the path at the position of the car."""
        errors = (
            state.ey_m - path.c0_m,
            state.epsi_rad - atan(path.c1),
            state.vx_mps - path.v_mps,
        )
        for i, error in enumerate(errors):
            self._squares[i] += error * error
            self._peaks[i] = max(self._peaks[i], abs(error))
        self.ticks += 1

    def errors(self) -> TrackingErrors:
        """Errors over all ticks so far; zeros if there was none."""
        ey_rms_m, epsi_rms_rad, vx_rms_mps = (
            sqrt(square / max(self.ticks, 1)) for square in self._squares
        )
        ey_peak_m, epsi_peak_rad, vx_peak_mps = self._peaks
        return TrackingErrors(
            ey_rms_m, ey_peak_m, epsi_rms_rad, epsi_peak_rad, vx_rms_mps, vx_peak_mps
        )
