"""Recorder of a drive in memory: the last ticks, and the tracking errors of all of them."""

from math import atan, nan

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_EXOGENOUS, N_STATES, ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.table import COLUMNS, REFERENCE, Drive, TrackingErrors
from rt_controller.safety.tick import Tick

_NO_STATE = (nan,) * (N_STATES + N_EXOGENOUS)
_NO_PATH = (nan,) * len(REFERENCE)


class DriveTrace:
    """Rows of the last `capacity` ticks, columns as `drive.COLUMNS`; allocated before the drive."""

    def __init__(self, capacity: int) -> None:
        self._rows = np.zeros((capacity, len(COLUMNS)))
        self._start_ns: int | None = None
        self._ticks = 0
        self._driven_ticks = [0, 0, 0]
        self._squares = [0.0, 0.0, 0.0]
        self._peaks = [0.0, 0.0, 0.0]
        self._ticks_at_limit = [0, 0, 0]
        self._s_m = self._ds_m = 0.0
        self._drove = False
        """True if the tick before drove, so that the car has moved since"""

    def record(self, result: Tick, now_ns: int) -> None:
        """Add one tick at `now_ns` on the clock of the loop."""
        if self._start_ns is None:
            self._start_ns = now_ns
        state, path = result.state, result.path
        if state is not None:
            self._ds_m = state.ds_m
        if self._drove:
            self._s_m += self._ds_m
        self._drove = result.mode is not Mode.STANDBY
        reference = _NO_PATH if path is None else (path.c0_m, atan(path.c1), path.v_mps)
        self._rows[self._ticks % len(self._rows)] = (
            (now_ns - self._start_ns) * 1e-9,
            *(_NO_STATE if state is None else (*state, result.curvature_per_m)),
            *reference,
            *result.control,
            result.mode,
            self._s_m,
        )
        self._ticks += 1
        if self._drove:
            bounds = result.limits.upper
            for i, (value, bound) in enumerate(zip(result.control, bounds, strict=True)):
                self._ticks_at_limit[i] += abs(value) >= (1.0 - 1e-6) * bound
        if result.mode is Mode.STANDBY or state is None or path is None:
            return
        car = (state.ey_m, state.epsi_rad, state.vx_mps)
        # A safe stop follows the path, and not the wanted speed.
        judged = 2 if result.mode is Mode.SAFE_STOP else 3
        for i, (found, wanted) in enumerate(zip(car[:judged], reference, strict=False)):
            self._driven_ticks[i] += 1
            error = found - wanted
            self._squares[i] += error * error
            self._peaks[i] = max(self._peaks[i], abs(error))

    @property
    def times_ns(self) -> Array:
        """Times of the ticks that are kept on the clock of the loop, oldest first."""
        return (self._start_ns or 0) + 1e9 * self._kept_rows()[:, 0]

    @property
    def last_tick(self) -> int:
        """Number of the last tick, counted from zero."""
        return self._ticks - 1

    @property
    def last_s(self) -> float:
        """Time of the last tick since the first one."""
        return round(float(self._rows[self.last_tick % len(self._rows), 0]), 6)

    def errors(self) -> TrackingErrors:
        """Over the ticks that drove, of the speed those without a safe stop; zeros without any."""
        rms = np.sqrt(np.array(self._squares) / np.maximum(self._driven_ticks, 1))
        return TrackingErrors(*np.stack([rms, self._peaks], axis=1).ravel().tolist())

    def at_limit_s(self) -> ControlInput:
        """Time for which each input was at its upper bound, the steering wheel at either."""
        return ControlInput(*(ticks * PERIOD_S for ticks in self._ticks_at_limit))

    def drive(self, model: str, ending: str) -> Drive:
        """The ticks that are kept, oldest first."""
        return Drive(self._kept_rows(), self.errors(), model, ending, at_limit_s=self.at_limit_s())

    def _kept_rows(self) -> Array:
        kept = len(self._rows)
        if self._ticks > kept:
            return np.roll(self._rows, -(self._ticks % kept), axis=0)
        return self._rows[: self._ticks].copy()
