"""Recorder of a drive in memory: the last ticks, one row each, allocated before the drive."""

from math import atan, nan

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.schema import N_STATES
from rt_controller.contract.signals import EXOGENOUS_FIELDS
from rt_controller.drive import COLUMNS, REFERENCE
from rt_controller.step import StepResult

_NO_STATE = (nan,) * (N_STATES + len(EXOGENOUS_FIELDS))
_NO_PATH = (nan,) * len(REFERENCE)


class DriveTrace:
    """Rows of the last `capacity` ticks, columns as `drive.COLUMNS`."""

    def __init__(self, capacity: int) -> None:
        self._rows = np.zeros((capacity, len(COLUMNS)))
        self._start_ns: int | None = None
        self._ticks = 0

    def record(self, result: StepResult, now_ns: int) -> None:
        """Append the row of one tick at `now_ns` on the clock of the loop."""
        if self._start_ns is None:
            self._start_ns = now_ns
        state, path = result.state, result.path
        self._rows[self._ticks % len(self._rows)] = (
            (now_ns - self._start_ns) * 1e-9,
            *(_NO_STATE if state is None else (*state.state, state.curvature_per_m)),
            *(_NO_PATH if path is None else (path.c0_m, atan(path.c1), path.v_mps)),
            *result.control,
            result.mode,
        )
        self._ticks += 1

    def rows(self) -> Array:
        """(ticks, columns), oldest first."""
        kept = len(self._rows)
        if self._ticks <= kept:
            return self._rows[: self._ticks].copy()
        return np.roll(self._rows, -(self._ticks % kept), axis=0)
