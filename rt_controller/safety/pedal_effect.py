"""Comparison of the speed of a slow car with its pedals.

Below the speeds of the model nothing else predicts the speed. With a speed signal that stays at
zero the low-speed law would open the throttle more and more.
"""

from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S

LAG_S = 0.3
"""time constant from the pedals to the acceleration"""
MEMORY_S = 1.0
"""time constant with which the missing speed decays: on a slope the throttle adds no speed"""


class PedalEffect:
    """Sums up the speed that the pedals should have added and that is not measured."""

    def __init__(self, throttle_mps2: float, brake_mps2_per_n: float) -> None:
        """The accelerations of a slow car by its pedals."""
        self._throttle_mps2 = throttle_mps2
        self._brake_mps2_per_n = brake_mps2_per_n
        self._pedals_mps2 = self._missing_mps = 0.0

    def begin(self) -> None:
        """The car is driven by its pedals from now on, or is fast enough for the model."""
        self._pedals_mps2 = self._missing_mps = 0.0

    def missing_mps(
        self, applied: ControlInput, before_mps: float, now_mps: float, periods: int
    ) -> float:
        """Speed that is missing after a tick in which `applied` acted; 0: none, or too much."""
        time_s = periods * PERIOD_S
        asked_mps2 = (
            applied.throttle * self._throttle_mps2 - applied.brake_n * self._brake_mps2_per_n
        )
        self._pedals_mps2 += min(time_s / LAG_S, 1.0) * (asked_mps2 - self._pedals_mps2)
        added_mps = time_s * self._pedals_mps2 - (now_mps - before_mps)
        kept = max(1.0 - time_s / MEMORY_S, 0.0)
        self._missing_mps = max(kept * self._missing_mps + added_mps, 0.0)
        return self._missing_mps
