"""A car that rolls along a line: point mass with lagged pedals and creep, single-track steering.

`ASSUMED` are the numbers that the low-speed law has of it in the tests.
"""

from dataclasses import dataclass
from math import atan, cos, sin, tan

from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.limits import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.low_speed import LowSpeedCar, PedalGains, SpeedRange

ASSUMED = LowSpeedCar(
    DEFAULT_CAR,
    PedalGains(throttle_mps2=6.0, brake_mps2_per_n=0.053),
    SpeedRange(leave_mps=3.0, resume_mps=4.0),
    hold_n=75.0,
)
_STEPS = 5
_DT_S = PERIOD_S / _STEPS


@dataclass(slots=True)
class RollingCar:
    """Its parameters need not be those that a controller assumes."""

    vx_mps: float
    throttle_mps2: float = 5.0
    brake_mps2_per_n: float = 0.053
    lag_s: float = 0.15
    creep_mps2: float = 0.8
    """of an idling automatic transmission at rest; zero at 1.7 m/s, negative above"""
    slope_mps2: float = 0.0
    """acceleration by the slope"""
    geometry: SteeringGeometry = DEFAULT_GEOMETRY
    curvature_per_m: float = 0.0
    """of the road"""
    s_m: float = 0.0
    ey_m: float = 0.0
    epsi_rad: float = 0.0
    _drive_mps2: float = 0.0
    _brake_mps2: float = 0.0

    def step(self, control: ControlInput) -> VehicleState:
        """The state one period later."""
        s_before_m = self.s_m
        share = min(_DT_S / self.lag_s, 1.0)
        for _ in range(_STEPS):
            self._drive_mps2 += share * (control.throttle * self.throttle_mps2 - self._drive_mps2)
            self._brake_mps2 += share * (control.brake_n * self.brake_mps2_per_n - self._brake_mps2)
            self.vx_mps += _DT_S * (self._drive_mps2 + self.resistance_mps2())
            braked = _DT_S * self._brake_mps2
            self.vx_mps -= min(max(self.vx_mps, -braked), braked)
            self._roll(control.steer_rad)
        return self.state(self.s_m - s_before_m, control.steer_rad)

    def state(self, ds_m: float = 0.0, steer_rad: float = NEUTRAL_INPUT.steer_rad) -> VehicleState:
        """What the bus would carry."""
        curvature = tan(steer_rad / self.geometry.steering_ratio) / self.geometry.wheelbase_m
        return VehicleState(
            vx_mps=self.vx_mps,
            vy_mps=self.vx_mps * self.geometry.rear_axle_m * curvature,
            yaw_rate_radps=self.vx_mps * curvature,
            ds_m=ds_m,
            ey_m=self.ey_m,
            epsi_rad=self.epsi_rad,
        )

    def resistance_mps2(self) -> float:
        """Acceleration that the pedals do not cause."""
        return self.slope_mps2 + max(self.creep_mps2 * (1.0 - self.vx_mps / 1.7), -0.3)

    def _roll(self, steer_rad: float) -> None:
        curvature = tan(steer_rad / self.geometry.steering_ratio) / self.geometry.wheelbase_m
        course = self.epsi_rad + atan(self.geometry.rear_axle_m * curvature)
        rolled_m = self.vx_mps * _DT_S
        progress_m = rolled_m * cos(course) / (1.0 - self.curvature_per_m * self.ey_m)
        self.s_m += progress_m
        self.ey_m += rolled_m * sin(course)
        self.epsi_rad += rolled_m * curvature - self.curvature_per_m * progress_m
