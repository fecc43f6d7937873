"""The law that drives where no model is trained: start, creep, stop and hold."""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.contract.steering_geometry import PLAN_TURN_MPS2, SteeringGeometry
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.low_speed.handover import AT_REST_MPS, SpeedRange, next_law
from rt_controller.control.low_speed.speed import (
    BRAKED_MPS,
    LARGEST_CHANGE_MPS2,
    PedalGains,
    lagged_mps2,
    next_disturbance,
    pedal_mps2,
    pedals_for,
    wanted_mps2,
)
from rt_controller.control.low_speed.steering import (
    LARGEST_TURN_MPS2,
    NO_ERROR,
    curvature_of,
    curvature_to_meet,
    largest_wheel_rad,
    path_curvature_per_m,
    roll_towards,
    wheel_angle_rad,
)

HOLD_RATE_N_PER_S = 150.0
"""the brake pedal of a standing car is pressed further at this rate"""
ROLLING_MPS = 0.5
"""the wheel of a car that rolls through its hold faster than this follows the path"""


class LowSpeedCar(NamedTuple):
    """Numbers of the car that the law is computed from."""

    geometry: SteeringGeometry
    gains: PedalGains
    speeds: SpeedRange
    hold_n: float
    """force on the brake pedal of a standing car"""
    model_rad: float = INPUT_LIMITS.upper.steer_rad
    """largest angle of the steering wheel that the model was trained with"""


class LowSpeedLaw:
    """Input at low speed and at standstill; remembers law, disturbance and last acceleration."""

    def __init__(self, car: LowSpeedCar) -> None:
        self.law = self._law_before = Mode.NOMINAL
        """that of the last tick: NOMINAL, LOW_SPEED or STANDSTILL"""
        self._car = car
        self._disturbance_mps2 = 0.0
        self._pedals_mps2 = 0.0
        self._wanted_mps2 = 0.0
        self._last_vx_mps: float | None = None
        self._turn_error = NO_ERROR

    def observe(self, state: VehicleState, applied: ControlInput) -> None:
        """Estimate the disturbances from the motion after `applied` acted for one period."""
        vx_mps = state.vx_mps
        self._turn_error = self._turn_error.after(state, applied.steer_rad, self._car.geometry)
        last_mps, self._last_vx_mps = self._last_vx_mps, vx_mps
        self._pedals_mps2 = lagged_mps2(self._pedals_mps2, pedal_mps2(applied, self._car.gains))
        if self.law is Mode.STANDSTILL or last_mps is None:
            return
        found_mps2 = (vx_mps - last_mps) / PERIOD_S - self._pedals_mps2
        mean_mps = 0.5 * (last_mps + vx_mps)  # its noise is independent of the acceleration's
        if self._pedals_mps2 < 0.0:
            # At rest, and rolling back, the brake does not act like a deceleration. An estimate
            # that keeps it pressed would hold a car that is wanted to move: it decays.
            if mean_mps < BRAKED_MPS and self._wanted_mps2 > 0.0:
                found_mps2 = min(self._disturbance_mps2, 0.0)
            elif mean_mps < AT_REST_MPS:
                return
        self._disturbance_mps2 = next_disturbance(self._disturbance_mps2, found_mps2)

    def forget(self) -> None:
        """A period is missing before the next state: no acceleration can be computed from it."""
        self._last_vx_mps = None

    def reset(self) -> None:
        """Forget everything: another driver has the car."""
        self.forget()
        self.law = self._law_before = Mode.NOMINAL
        self._disturbance_mps2 = self._pedals_mps2 = self._wanted_mps2 = 0.0
        self._turn_error = NO_ERROR

    def largest_wheel_rad(self, vx_mps: float) -> float:
        """Bound of the wheel angle at this speed."""
        return largest_wheel_rad(vx_mps, self._car.geometry)

    def largest_plan_rad(self, vx_mps: float) -> float:
        """Bound of the wheel angle of the model's plans at this speed."""
        car = self._car
        return min(car.geometry.largest_wheel_rad(vx_mps, PLAN_TURN_MPS2), car.model_rad)

    def choose(self, vx_mps: float, path: PathReference, wheel_rad: float = 0.0) -> Mode:
        """The law of this tick, with the wheel at `wheel_rad`."""
        is_turned = abs(wheel_rad) > self.largest_plan_rad(vx_mps)
        following = next_law(self.law, vx_mps, path, self._car.speeds, is_turned)
        self._law_before, self.law = self.law, following
        return self.law

    def control(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        last: ControlInput,
        under_way: Sequence[ControlInput] = (),
        preview: CurvaturePreview | None = None,
    ) -> ControlInput:
        """Input of this tick, after `last`; of the law that was chosen.

        Args:
            state: of the car.
            curvature_per_m: of the road at the car.
            path: to follow.
            last: input of the last tick.
            under_way: inputs that were sent and act before it.
            preview: curvature of the road ahead; None: constant.
        """
        if preview is not None and state.vx_mps >= AT_REST_MPS:
            delay_m = state.vx_mps * PERIOD_S * len(under_way)
            curvature_per_m = curvature_to_meet(
                preview, delay_m, state.vx_mps, last.steer_rad, self._car.geometry
            )
        if self.law is Mode.STANDSTILL:
            held = hold(state.vx_mps, last, self._car.hold_n)
            if state.vx_mps < ROLLING_MPS:
                return held
            return held._replace(steer_rad=self.steer_rad(state, curvature_per_m, path, last))
        gains = self._car.gains
        if self._law_before is Mode.STANDSTILL:
            self._wanted_mps2 = 0.0
        elif self._law_before is Mode.NOMINAL:  # continue from the present acceleration
            self._wanted_mps2 = pedal_mps2(last, gains) + self._disturbance_mps2
        is_turned = abs(last.steer_rad) > self.largest_plan_rad(state.vx_mps)
        path = self._slowed(path, curvature_per_m, is_turned)
        wanted = wanted_mps2(self._speed_after(under_way, state.vx_mps), path)
        change = min(max(wanted - self._wanted_mps2, -LARGEST_CHANGE_MPS2), LARGEST_CHANGE_MPS2)
        self._wanted_mps2 += change
        throttle, brake_n = pedals_for(self._wanted_mps2 - self._disturbance_mps2, last, gains)
        return ControlInput(
            throttle=min(throttle, INPUT_LIMITS.upper.throttle),
            brake_n=min(brake_n, INPUT_LIMITS.upper.brake_n),
            steer_rad=self.steer_rad(state, curvature_per_m, path, last),
        )

    def _slowed(
        self, path: PathReference, curvature_per_m: float, is_turned: bool
    ) -> PathReference:
        """The path at a speed that its curvature allows, and the wheel: see `next_law`."""
        turn_per_m = abs(curvature_per_m + 2.0 * path.c2_per_m)
        v_mps = sqrt(LARGEST_TURN_MPS2 / max(turn_per_m, 1e-6))
        if is_turned:
            v_mps = min(v_mps, self._car.speeds.resume_mps)
        return (
            path
            if path.v_mps <= v_mps
            else path._replace(v_mps=v_mps, a_mps2=min(path.a_mps2, 0.0))
        )

    def _speed_after(self, under_way: Sequence[ControlInput], vx_mps: float) -> float:
        """Speed that is predicted when the inputs under way have acted."""
        pedals_mps2 = self._pedals_mps2
        for control in under_way:
            pedals_mps2 = lagged_mps2(pedals_mps2, pedal_mps2(control, self._car.gains))
            vx_mps += PERIOD_S * (pedals_mps2 + self._disturbance_mps2)
        return vx_mps

    def steer_rad(
        self, state: VehicleState, curvature_per_m: float, path: PathReference, last: ControlInput
    ) -> float:
        """Wheel angle along the path, as far as the car rolls."""
        geometry = self._car.geometry
        most_rad = self.largest_wheel_rad(state.vx_mps)
        curvature = path_curvature_per_m(
            state,
            path,
            curvature_per_m,
            geometry,
            curvature_of(most_rad, geometry),
            self._turn_error,
        )
        wanted_rad = min(
            max(wheel_angle_rad(curvature, state.vx_mps, geometry), -most_rad), most_rad
        )
        return roll_towards(wanted_rad, last.steer_rad, state.vx_mps)


def hold(vx_mps: float, last: ControlInput, hold_n: float) -> ControlInput:
    """Input of a standing car: brake pressed, wheel where it is; harder if the car rolls."""
    rolls = abs(vx_mps) >= AT_REST_MPS
    target_n = INPUT_LIMITS.upper.brake_n if rolls else max(hold_n, last.brake_n)
    brake_n = min(last.brake_n + HOLD_RATE_N_PER_S * PERIOD_S, target_n)
    return ControlInput(throttle=0.0, brake_n=brake_n, steer_rad=last.steer_rad)
