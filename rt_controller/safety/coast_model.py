"""What the pedals and the wheel do to a car without a model of it: coasting and braking."""

from math import tan
from typing import NamedTuple

from rt_controller.contract.limits import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S

LEAST_MODELLED_MPS = 7.0
"""below it the model has little data, and its predictions drift; slow cars turn by geometry"""


class StoppingCar(NamedTuple):
    """Constants of the car, for its motion without a model."""

    geometry: SteeringGeometry = DEFAULT_GEOMETRY
    brake_mps2_per_n: float = 0.05
    """deceleration; too small a value makes the stop seem longer than it is"""
    throttle_mps2: float = 6.0
    """acceleration with the throttle fully open"""
    modelled_mps: float = LEAST_MODELLED_MPS
    """speed below which the model is not used"""

    def motion(self, vx_mps: float, control: ControlInput) -> tuple[float, float, float]:
        """(v_x, v_y, yaw rate) one period later, without sideslip of the tyres."""
        vx_mps = max(vx_mps - self.brake_mps2_per_n * control.brake_n * PERIOD_S, 0.0)
        wheelbase_m, rear_axle_m, ratio, _ = self.geometry
        yaw_rate = vx_mps * tan(control.steer_rad / ratio) / wheelbase_m
        return vx_mps, rear_axle_m * yaw_rate, yaw_rate


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
