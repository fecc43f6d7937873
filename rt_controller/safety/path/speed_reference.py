"""Comparison of the wanted speed with the wanted acceleration that is sent with it."""

from collections import deque

from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S

AHEAD_TICKS = round(0.6 / PERIOD_S)
"""an acceleration may belong to a change of speed so far ahead, as before a stop"""
MEMORY_S = 2.0
"""time constant with which the unexplained change decays"""
FASTEST_MPS2 = 12.0
"""of one tick in that sum; the check of one step finds a step of the wanted speed"""


class SpeedReference:
    """Sums up the change of the wanted speed that no recent acceleration explains."""

    def __init__(self) -> None:
        self._accelerations: deque[float] = deque(maxlen=AHEAD_TICKS)
        self._last_mps = 0.0
        self._drift_mps = 0.0

    def begin(self) -> None:
        """Restart without a path."""
        self._accelerations.clear()
        self._drift_mps = 0.0

    def drift_mps(self, path: PathReference, age_s: float) -> float:
        """Size of the sum with a new path, `age_s` after the last one that was accepted."""
        known = self._accelerations
        if not known or age_s <= 0.0:
            return abs(self._drift_mps)
        lowest, highest = min(*known, path.a_mps2), max(*known, path.a_mps2)
        rate_mps2 = (path.v_mps - self._last_mps) / age_s
        excess_mps2 = rate_mps2 - min(max(rate_mps2, lowest), highest)
        self._drift_mps *= 1.0 - PERIOD_S / MEMORY_S
        self._drift_mps += age_s * min(max(excess_mps2, -FASTEST_MPS2), FASTEST_MPS2)
        return abs(self._drift_mps)

    def accept(self, path: PathReference) -> None:
        """Store a path that may be followed."""
        self._accelerations.append(path.a_mps2)
        self._last_mps = path.v_mps
