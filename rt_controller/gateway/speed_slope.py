"""Acceleration of a wanted speed, for a car that sends no wanted acceleration."""

from collections import deque
from math import isfinite

from rt_controller.contract.timing import PERIOD_S

WINDOW_S = 0.5
"""longer than the cycle of most messages: a speed that changes in steps has a smooth slope"""
LARGEST_MPS2 = 3.0


class SpeedSlope:
    """Slope of the wanted speed over the last half second."""

    def __init__(self) -> None:
        self._speeds: deque[tuple[int, float]] = deque(maxlen=round(WINDOW_S / PERIOD_S) + 1)

    def mps2(self, speed_mps: float, now_ns: int) -> float:
        """The slope with the speed of this period; 0 in the first one, and of a speed that is NaN.

        A gap of the window or longer, or a NaN, begins a new slope.
        """
        speeds = self._speeds
        if not isfinite(speed_mps) or (speeds and now_ns - speeds[-1][0] > WINDOW_S * 1e9):
            speeds.clear()
        if not isfinite(speed_mps):
            return 0.0
        speeds.append((now_ns, speed_mps))
        first_ns, first_mps = speeds[0]
        if now_ns == first_ns:
            return 0.0
        slope_mps2 = (speed_mps - first_mps) / (1e-9 * (now_ns - first_ns))
        return min(max(slope_mps2, -LARGEST_MPS2), LARGEST_MPS2)
