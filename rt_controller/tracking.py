"""How well the car followed: running sums over the ticks that drove, in constant memory."""

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
    """Sums of squares and peaks, one tick at a time."""

    def __init__(self) -> None:
        self._squares = [0.0, 0.0, 0.0]
        self._peaks = [0.0, 0.0, 0.0]
        self.ticks = 0

    def record(self, state: VehicleState, path: PathReference) -> None:
        """Account for one tick: the path at the car is what the car should be on."""
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
        """Over all ticks so far; zeros if there was none."""
        rms = [sqrt(square / max(self.ticks, 1)) for square in self._squares]
        return TrackingErrors(
            ey_rms_m=rms[0],
            ey_peak_m=self._peaks[0],
            epsi_rms_rad=rms[1],
            epsi_peak_rad=self._peaks[1],
            vx_rms_mps=rms[2],
            vx_peak_mps=self._peaks[2],
        )
