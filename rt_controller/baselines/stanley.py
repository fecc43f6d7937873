"""Stanley steering with feed-forward of the curvature, and PI control of the speed.

Hoffmann, Tomlin, Montemerlo and Thrun, "Autonomous automobile trajectory tracking for off-road
driving" (2007): heading error, arctangent of the lateral error at the front axle, damping of the
yaw rate. Feed-forward of the curvature ahead has a term of understeer; the heading of a steady bend
has its sideslip. The state is predicted by the fitted bicycle over the inputs under way, so the
delay is compensated, and its measurement is filtered as that of `Mpc`.
"""

from math import atan, atan2
from typing import NamedTuple

import numpy as np

from rt_controller.baselines.bicycle import Bicycle
from rt_controller.baselines.tuned import tuned_values
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, PathReference, StateColumn, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.estimator import MOTION_GAIN, Estimator
from rt_controller.control.knots import place_knots
from rt_controller.control.law import Observation
from rt_controller.control.pedals import Pedal, PedalChoice
from rt_controller.control.reference import ReferenceHorizon

_AHEAD = 12
"""periods over which the path is evaluated"""
_SLOWEST_MPS = 3.0
_MOST_INTEGRAL_MPS2, _INTEGRATED_MPS = 1.5, 1.0
_MOST_OFFSET_M, _INTEGRATED_M = 0.1, 0.2


class Gains(NamedTuple):
    """What the search chooses."""

    lateral_per_s: float = 2.0
    softening_mps: float = 2.0
    """added to the speed that divides the lateral error"""
    heading: float = 1.0
    yaw_damping_s: float = 0.05
    """front-wheel angle per error of the yaw rate"""
    understeer_rad_per_mps2: float = 0.0025
    sideslip_s2_per_m: float = 0.005
    """sideslip of a steady bend: curvature * (rear axle - this * speed²)"""
    preview_s: float = 0.1
    """time ahead, after the delay, of the curvature that is fed forward"""
    integral_per_s: float = 0.2
    """of the lateral error"""
    speed_per_s: float = 1.0
    speed_integral_per_s2: float = 0.2


class Stanley:
    """The law; a `ControlLaw`."""

    def __init__(self, gains: Gains | None = None) -> None:
        """`gains`: default those that the search found."""
        self._gains = gains or Gains(**tuned_values("stanley"))
        self._bicycle = Bicycle()
        self._reference = ReferenceHorizon(place_knots(_AHEAD, _AHEAD))
        self._pedals = PedalChoice()
        self._estimator = Estimator(self._bicycle.bundle(), 0, MOTION_GAIN, self._bicycle.step)
        self._curvature_per_m = 0.0
        self._speed_integral_mps2 = self._offset_m = 0.0
        self._is_first = True

    def reset(self) -> None:
        """The next observation does not follow on the last one."""
        self._estimator.reset()
        self._speed_integral_mps2 = self._offset_m = 0.0
        self._is_first = True

    def control(self, now: Observation) -> ControlInput:
        """Pedals and steering wheel of this period."""
        if self._is_first:
            self._pedals.resume(now.previous)
        self._is_first = False
        state = self._estimator.estimate(now.state, self._curvature_per_m)
        kappa = self._curvature_per_m = now.curvature_per_m
        psi = np.array(state)
        for u in now.under_way:
            psi = self._bicycle.step(psi, u, kappa)
        delay = len(now.under_way)
        reference = self._reference.expand(now.path, state, kappa, now.preview, delay)
        wheel_rad = self._front_wheel_rad(VehicleState(*psi.tolist()), reference)
        wheel_rad *= DEFAULT_GEOMETRY.steering_ratio / self._estimator.steering.value
        control = ControlInput(*self._pedals_of(state.vx_mps, now.path), wheel_rad)
        # The input that acts until the next observation, which is filtered with the prediction.
        acting = now.under_way[0] if now.under_way else control
        self._estimator.advance(np.array(state), acting, kappa)
        return control

    def _front_wheel_rad(self, state: VehicleState, reference: Array) -> float:
        """Angle of the front wheels; `reference` (13, 6) from the state on, a row each period."""
        gains, speed_mps = self._gains, max(state.vx_mps, _SLOWEST_MPS)
        curvatures = reference[:, StateColumn.yaw_rate_radps] / np.maximum(
            reference[:, StateColumn.vx_mps], _SLOWEST_MPS
        )
        times_s = PERIOD_S * np.arange(len(reference))
        here, ahead = np.interp((0.0, gains.preview_s), times_s, curvatures).tolist()
        wheelbase_m, rear_m, *_ = DEFAULT_GEOMETRY
        front_m = wheelbase_m - rear_m
        slip_rad = here * (rear_m - gains.sideslip_s2_per_m * speed_mps**2)
        heading_rad = state.epsi_rad + slip_rad - reference[0, StateColumn.epsi_rad]
        error_m = state.ey_m - reference[0, StateColumn.ey_m]
        if abs(error_m) < _INTEGRATED_M:
            changed_m = self._offset_m + gains.integral_per_s * PERIOD_S * error_m
            self._offset_m = min(max(changed_m, -_MOST_OFFSET_M), _MOST_OFFSET_M)
        error_m += front_m * heading_rad + self._offset_m
        forward = wheelbase_m * ahead + gains.understeer_rad_per_mps2 * speed_mps**2 * ahead
        turning = state.yaw_rate_radps - speed_mps * here
        lateral = atan2(gains.lateral_per_s * error_m, gains.softening_mps + speed_mps)
        return float(
            atan(forward) - gains.heading * heading_rad - lateral - gains.yaw_damping_s * turning
        )

    def _pedals_of(self, speed_mps: float, path: PathReference) -> tuple[float, float]:
        """Throttle and brake for the acceleration of the path and the error of the speed."""
        gains, car = self._gains, self._bicycle.parameters
        error_mps = path.v_mps - speed_mps
        if abs(error_mps) < _INTEGRATED_MPS:
            changed = self._speed_integral_mps2 + gains.speed_integral_per_s2 * PERIOD_S * error_mps
            self._speed_integral_mps2 = min(max(changed, -_MOST_INTEGRAL_MPS2), _MOST_INTEGRAL_MPS2)
        wanted = path.a_mps2 + gains.speed_per_s * error_mps + self._speed_integral_mps2
        wanted += car.rolling_mps2 + car.drag_per_m * speed_mps**2
        self._pedals.update(wanted)
        if self._pedals.pedal is Pedal.BRAKE:
            return 0.0, min(max(-wanted / car.brake_mps2_per_n, 0.0), INPUT_LIMITS.upper.brake_n)
        return car.throttle_for(wanted / float(car.full_throttle_mps2(speed_mps))), 0.0
