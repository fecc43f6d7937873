"""Stanley steering with feed-forward of the curvature, and PI control of the speed.

Hoffmann, Tomlin, Montemerlo and Thrun, "Autonomous automobile trajectory tracking for off-road
driving" (2007): heading error, arctangent of the lateral error at the front axle, damping of the
yaw rate. Feed-forward of the curvature ahead has a term of understeer; the heading of a steady bend
has its sideslip. The state is predicted by the fitted bicycle over the inputs under way, so the
delay is compensated, and its measurement is filtered as that of `Mpc`.
"""

from collections.abc import Sequence
from math import atan, atan2
from typing import Any, NamedTuple

import numpy as np

from benchmarks.rivals.bicycle import Bicycle
from benchmarks.rivals.ltv_mpc import bicycle_estimator
from rt_controller.contract.limits import DEFAULT_GEOMETRY, INPUT_LIMITS
from rt_controller.contract.signals import (
    N_INPUTS,
    N_STATES,
    ControlInput,
    CurvaturePreview,
    InputColumn,
    PathReference,
    StateColumn,
    VehicleState,
)
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_S
from rt_controller.control.knots import place_knots
from rt_controller.control.pedals import Pedal, PedalChoice, limit_pedals
from rt_controller.control.program import SolveStatus
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
    """The law, with the methods of `Mpc` that the loop calls."""

    iterations = solve_ns = 0
    lifted = max_iterations = None

    def __init__(self, bicycle: Bicycle, gains: Gains) -> None:
        self._bicycle, self._gains = bicycle, gains
        self._reference = ReferenceHorizon(place_knots(_AHEAD, _AHEAD))
        lower, upper = np.array(INPUT_LIMITS.lower), np.array(INPUT_LIMITS.upper)
        self._scale = upper - lower
        self._lower, self._upper = lower / self._scale, upper / self._scale
        self._slew = np.array(INPUT_LIMITS.rate_per_s) * PERIOD_S / self._scale
        self._pedals = PedalChoice()
        self._estimator = bicycle_estimator(bicycle, bicycle.bundle())
        self._now, self._curvature_per_m = np.zeros(N_STATES), 0.0
        self._acting: ControlInput | None = None
        self._has_plan = False
        self._speed_integral_mps2 = self._offset_m = 0.0
        self.inputs = np.zeros((HOLD_PLAN_TICKS + 1, N_INPUTS))
        """(3, 3), the input of this period, held"""

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        """As `Mpc.plan`."""
        psi, kappa = np.array([state]), np.array([[curvature_per_m]])
        self._now, self._curvature_per_m = psi[0], curvature_per_m
        for u in under_way:
            psi = self._bicycle.step(psi, np.array([u]), kappa)
        reference = self._reference.expand(path, state, curvature_per_m, preview, len(under_way))
        after = VehicleState(*psi[0].tolist())
        self._acting = under_way[0] if under_way else None
        wheel_rad = self._front_wheel_rad(after, reference) * DEFAULT_GEOMETRY.steering_ratio
        throttle, brake_n = self._pedals_of(state.vx_mps, path)
        scale, slew = self._scale, self._slew
        wanted, last = np.array([throttle, brake_n, wheel_rad]) / scale, np.array(previous) / scale
        upper = self._upper[None].copy()
        limit_pedals(upper, np.ones(1, dtype=np.int64), self._pedals, last, slew)
        wanted = np.clip(wanted, self._lower, upper[0])
        self.inputs[:] = np.clip(wanted, last - slew, last + slew) * scale
        self._has_plan = True
        return SolveStatus.SOLVED

    def _front_wheel_rad(self, state: VehicleState, reference: Any) -> float:
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

    def prepare(self) -> None:
        """Predict the next state, which its measurement is filtered with."""
        if self._has_plan:
            acting = self._acting or ControlInput(*self.inputs[0].tolist())
            self._estimator.advance(self._now, acting, self._curvature_per_m)
        self._has_plan = False

    def observe(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """Filter `state` as `Mpc` does."""
        return self._estimator.estimate(state, self._curvature_per_m)

    observe_estimate = observe

    def forget(self) -> None:
        """A period or more is missing before the next state."""
        self._has_plan = False
        self._estimator.forget()

    def reset(self) -> None:
        """Another drive begins."""
        self.forget()
        self._estimator.reset()
        self._speed_integral_mps2 = self._offset_m = 0.0

    def resume(self, previous: ControlInput) -> None:
        """Continue after another law."""
        self._pedals.resume(previous)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Bound the wheel; no car of the comparison has a slow one."""
        wheel = InputColumn.steer_rad
        self._upper[wheel] = most_rad / self._scale[wheel]
        self._lower[wheel] = -self._upper[wheel]

    def _do_nothing(self, *_: Any) -> None:
        """There is no plan and no solver, and the cars of the comparison follow its commands."""

    warm_up = limit_solve_time = assume_steady = predicted_states = _do_nothing
