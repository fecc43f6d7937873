"""Comparison of the speed of a slow car with its pedals.

Below the speeds of the model nothing else predicts the speed. With a speed signal that stays at
zero the low-speed law would open the throttle more and more.
"""

from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S

LAG_S = 0.3
"""time constant from the pedals to the acceleration"""
MEMORY_S = 1.0
"""time constant with which the missing speed decays"""
OPEN_MPS2, HILL_MPS2 = 6.0, 2.0
"""acceleration of the default car with an open throttle, and deceleration by a hill of 20 %: up to
it the throttle may add no speed. For a weaker or stronger throttle both change in proportion"""
ANSWER = 0.04
"""of the acceleration by the throttle beyond the hill. A car that accelerates by so much answers
its throttle: another car, or wheels that spin"""


class PedalEffect:
    """Sums up the speed that the pedals should have added and that is not measured."""

    def __init__(self, throttle_mps2: float, brake_mps2_per_n: float) -> None:
        """The accelerations of a slow car by its pedals."""
        self._scale = OPEN_MPS2 / throttle_mps2
        self._brake_mps2_per_n = brake_mps2_per_n * self._scale
        self.begin()

    def begin(self) -> None:
        """The car is driven by its pedals from now on, or is fast enough for the model."""
        self._pedals_mps2 = self._answer_mps2 = self._missing_mps = 0.0

    def missing_mps(
        self, applied: ControlInput, before_mps: float, now_mps: float, periods: int
    ) -> float:
        """Speed that is missing after a tick in which `applied` acted; 0: none, or too much.

        Scaled to a car that accelerates by `OPEN_MPS2` with an open throttle.
        """
        time_s = periods * PERIOD_S
        asked_mps2 = applied.throttle * OPEN_MPS2 - applied.brake_n * self._brake_mps2_per_n
        measured_mps2 = self._scale * (now_mps - before_mps) / time_s
        new = min(time_s / LAG_S, 1.0)
        self._pedals_mps2 += new * (asked_mps2 - self._pedals_mps2)
        self._answer_mps2 += new * (measured_mps2 - self._answer_mps2)
        beyond_hill_mps2 = self._pedals_mps2 - HILL_MPS2
        kept = max(1.0 - time_s / MEMORY_S, 0.0)
        self._missing_mps *= kept
        if self._answer_mps2 < ANSWER * beyond_hill_mps2:
            self._missing_mps += time_s * (beyond_hill_mps2 - measured_mps2)
        self._missing_mps = max(self._missing_mps, 0.0)
        return self._missing_mps
