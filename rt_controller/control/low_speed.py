"""The law that drives where no model is trained: start, creep, stop and hold."""

from collections.abc import Sequence
from functools import partial
from math import inf, sqrt, tan
from typing import NamedTuple

from rt_controller.contract.car import Car
from rt_controller.contract.limits import INPUT_LIMITS, SteeringGeometry
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.steering import (
    AT_REST_MPS,
    LARGEST_TURN_MPS2,
    NO_ERROR,
    curvature_to_meet,
    path_curvature_per_m,
    roll_towards,
    wheel_angle_rad,
)


class RestReference(NamedTuple):
    """Reference of a standing car: highest speed and acceleration, and what is a stop."""

    v_mps: float
    a_mps2: float
    stop_m: float
    """longest distance to the stop"""
    braking_mps2: float
    """least deceleration that is a stop, not a change of speed"""


ARRIVE = RestReference(v_mps=AT_REST_MPS, a_mps2=0.1, stop_m=0.15, braking_mps2=0.2)
"""a slow car comes to rest within these limits, and is held within the next ones"""
STAY = RestReference(v_mps=0.2, a_mps2=0.2, stop_m=0.3, braking_mps2=0.1)


class SpeedRange(NamedTuple):
    """The low-speed law takes over below the first speed, the model above the second one."""

    leave_mps: float
    resume_mps: float


def stop_distance_m(path: PathReference) -> float:
    """Distance in which the reference speed falls to zero; inf if it does not fall.

    A path planner that sends v = sqrt(2 b d) and a = -b sends the distance d to the stop with it.
    """
    if path.a_mps2 >= 0.0:
        return inf
    return path.v_mps * path.v_mps / (-2.0 * path.a_mps2)


def wants_rest(path: PathReference, is_resting: bool) -> bool:
    """True if the reference is that of a standing car; `is_resting`: the last answer."""
    rest = STAY if is_resting else ARRIVE
    if path.a_mps2 > rest.a_mps2:
        return False
    is_stop = path.a_mps2 <= -rest.braking_mps2 and stop_distance_m(path) < rest.stop_m
    return is_stop or path.v_mps <= rest.v_mps


def next_law(
    law: Mode, vx_mps: float, path: PathReference, speeds: SpeedRange, is_turned: bool = False
) -> Mode:
    """The law of this tick after `law`: NOMINAL (the model), LOW_SPEED or STANDSTILL.

    The model does not take over a car whose wheel `is_turned` beyond the bound of its plans.

    Every threshold has a hysteresis, so noise of speed and reference does not change the law twice.
    """
    limit_mps = speeds.leave_mps if law is Mode.NOMINAL else speeds.resume_mps
    if vx_mps >= limit_mps and not (is_turned and law is not Mode.NOMINAL):
        return Mode.NOMINAL
    # A held car that rolls is for the brake too: the pedals of the law would release it.
    is_resting = law is Mode.STANDSTILL
    may_hold = is_resting or vx_mps < AT_REST_MPS
    return Mode.STANDSTILL if may_hold and wants_rest(path, is_resting) else Mode.LOW_SPEED


SPEED_GAIN_PER_S = 3.0
"""acceleration per speed error"""
STRONGEST_MPS2 = 2.0
"""acceleration, and braking beyond that of the reference"""
LARGEST_CHANGE_MPS2 = 10.0 * PERIOD_S
"""of the wanted acceleration in one period: a jerk of 10 m/s^3"""
PEDAL_LAG_S = 0.3
"""time constant from pedals to acceleration, usual for engines and hydraulic brakes"""
DISTURBANCE_TIME_S = 1.5
"""time constant of the estimated disturbance: longer than the lag"""
LARGEST_DISTURBANCE_MPS2 = 3.0
BRAKED_MPS = 0.3
"""a braked car that is wanted to move and seems slower than this may stand"""
PRESS_BRAKE_MPS2, PRESS_THROTTLE_MPS2 = -0.3, 0.1
"""acceleration by the pedals, below and above which the other pedal gives way to this one"""
SLOWEST_RATIO_MPS, FASTEST_RATIO = 0.1, 1.6
"""least reference speed, and largest ratio of the speed to it, in the braking towards a stop"""
FINAL_MPS2 = 1.0
"""least deceleration towards a reference that stands: the car does not creep to rest"""


class PedalGains(NamedTuple):
    """Steady acceleration of the car at low speed per unit of each pedal."""

    throttle_mps2: float
    """of the whole travel"""
    brake_mps2_per_n: float
    """deceleration"""


def wanted_mps2(vx_mps: float, path: PathReference) -> float:
    """Acceleration that leads the speed to its reference.

    Towards a stop the reference v = sqrt(2 b d) falls with the distance d. A car that is slower
    needs less than b to stop in the same distance, and a faster one more: b (v_x / v)^2.
    """
    v_mps, a_mps2 = path.v_mps, path.a_mps2
    forward = a_mps2
    if a_mps2 < 0.0:
        ratio = min(max(vx_mps, 0.0) / max(v_mps, SLOWEST_RATIO_MPS), FASTEST_RATIO)
        forward = a_mps2 * ratio * ratio
    if v_mps < ARRIVE.v_mps and a_mps2 < ARRIVE.a_mps2 and vx_mps > 0.0:
        forward -= FINAL_MPS2
    strongest_braking = min(a_mps2, 0.0) - STRONGEST_MPS2
    wanted = forward + SPEED_GAIN_PER_S * (v_mps - vx_mps)
    return min(max(wanted, strongest_braking), max(a_mps2, 0.0) + STRONGEST_MPS2)


def pedal_mps2(control: ControlInput, gains: PedalGains) -> float:
    """Acceleration that the pedals cause."""
    return control.throttle * gains.throttle_mps2 - control.brake_n * gains.brake_mps2_per_n


def lagged(before: float, target: float, time_s: float) -> float:
    """First-order lag of time constant `time_s` towards `target`, a period later."""
    return before + PERIOD_S / time_s * (target - before)


def pedals_for(
    acceleration_mps2: float, previous: ControlInput, gains: PedalGains
) -> tuple[float, float]:
    """(throttle, brake_n) for an acceleration by the pedals, one of them 0.

    Between the two thresholds both are released, if the wanted pedal is not pressed already.
    """
    if acceleration_mps2 < (0.0 if previous.brake_n > 0.0 else PRESS_BRAKE_MPS2):
        return 0.0, -acceleration_mps2 / gains.brake_mps2_per_n
    if acceleration_mps2 > (0.0 if previous.throttle > 0.0 else PRESS_THROTTLE_MPS2):
        return acceleration_mps2 / gains.throttle_mps2, 0.0
    return 0.0, 0.0


HOLD_RATE_N_PER_S = 150.0
"""the brake pedal of a standing car is pressed further at this rate"""
TIGHTER_MPS = 1.5
"""so much slower the model drives on in a bend that needs more than the wheel of the other law"""
ROLLING_MPS = 0.5
"""the wheel of a car that rolls through its hold faster than this follows the path"""


class LowSpeedCar(NamedTuple):
    """Numbers of the car that the law is computed from."""

    car: Car
    gains: PedalGains
    speeds: SpeedRange
    hold_n: float
    """force on the brake pedal of a standing car"""
    model_rad: float = INPUT_LIMITS.upper.steer_rad
    """largest angle of the steering wheel that the model was trained with"""

    @property
    def geometry(self) -> SteeringGeometry:
        return self.car.geometry


class LowSpeedLaw:
    """Input at low speed and at standstill; remembers law, disturbance and last acceleration."""

    def __init__(self, car: LowSpeedCar) -> None:
        self.law = self._law_before = Mode.NOMINAL
        """that of the last tick: NOMINAL, LOW_SPEED or STANDSTILL"""
        self._car = car
        self.largest_plan_rad = partial(car.car.largest_plan_rad, model_rad=car.model_rad)
        """bound of the wheel angle of the model's plans, by speed"""
        self._disturbance_mps2 = 0.0
        self._pedals_mps2 = 0.0
        self._wanted_mps2 = 0.0
        self._last_vx_mps: float | None = None
        self._turn_error = NO_ERROR
        self._is_turned = False
        """the wheel is turned beyond the bound of the model's plans"""
        self.most_plan_rad = car.model_rad
        """that bound, in this tick"""

    def observe(self, state: VehicleState, applied: ControlInput) -> None:
        """Estimate the disturbances from the motion after `applied` acted for one period."""
        vx_mps = state.vx_mps
        self._turn_error = self._turn_error.after(state, applied.steer_rad, self._car.geometry)
        last_mps, self._last_vx_mps = self._last_vx_mps, vx_mps
        pedals_mps2 = pedal_mps2(applied, self._car.gains)
        self._pedals_mps2 = lagged(self._pedals_mps2, pedals_mps2, PEDAL_LAG_S)
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
        estimate = lagged(self._disturbance_mps2, found_mps2, DISTURBANCE_TIME_S)
        most = LARGEST_DISTURBANCE_MPS2
        self._disturbance_mps2 = min(max(estimate, -most), most)

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
        return self._car.geometry.largest_wheel_rad(vx_mps, LARGEST_TURN_MPS2)

    def choose(self, vx_mps: float, path: PathReference, wheel_rad: float = 0.0) -> Mode:
        """The law of this tick, with the wheel at `wheel_rad`."""
        self.most_plan_rad = self.largest_plan_rad(vx_mps)
        self._is_turned = abs(wheel_rad) > self.most_plan_rad
        self._law_before, speeds = self.law, self._car.speeds
        if abs(wheel_rad) > self.largest_wheel_rad(vx_mps):
            speeds = speeds._replace(leave_mps=speeds.leave_mps - TIGHTER_MPS)
        self.law = next_law(self.law, vx_mps, path, speeds, self._is_turned)
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
        """Input of this tick, of the law that was chosen; arguments as of `InputPlanner.plan`."""
        if preview is not None and state.vx_mps >= AT_REST_MPS:
            delay_m = state.vx_mps * PERIOD_S * len(under_way)
            curvature_per_m = curvature_to_meet(
                preview,
                delay_m,
                state.vx_mps,
                last.steer_rad,
                self._car.geometry,
                self._car.car.limits.rate_per_s.steer_rad,
            )
        if self.law is Mode.STANDSTILL:
            # The brake is pressed further up to that of a hold, and entirely if the car rolls.
            rolls = abs(state.vx_mps) >= AT_REST_MPS
            scale = self._car.car.force_scale
            entirely_n = min(scale, 1.0) * self._car.car.limits.upper.brake_n
            most_n = entirely_n if rolls else max(self._car.hold_n, last.brake_n)
            brake_n = min(last.brake_n + scale * HOLD_RATE_N_PER_S * PERIOD_S, most_n)
            if state.vx_mps < ROLLING_MPS:
                return ControlInput(0.0, brake_n, last.steer_rad)
            return ControlInput(0.0, brake_n, self.steer_rad(state, curvature_per_m, path, last))
        gains = self._car.gains
        if self._law_before is Mode.STANDSTILL:
            self._wanted_mps2 = 0.0
        elif self._law_before is Mode.NOMINAL:  # continue from the present acceleration
            self._wanted_mps2 = pedal_mps2(last, gains) + self._disturbance_mps2
        path = self._slowed(path, curvature_per_m)
        wanted = wanted_mps2(self._speed_after(under_way, state.vx_mps), path)
        change = wanted - self._wanted_mps2
        self._wanted_mps2 += min(max(change, -LARGEST_CHANGE_MPS2), LARGEST_CHANGE_MPS2)
        throttle, brake_n = pedals_for(self._wanted_mps2 - self._disturbance_mps2, last, gains)
        upper = self._car.car.limits.upper
        return ControlInput(
            throttle=min(throttle, upper.throttle),
            brake_n=min(brake_n, upper.brake_n),
            steer_rad=self.steer_rad(state, curvature_per_m, path, last),
        )

    def _slowed(self, path: PathReference, curvature_per_m: float) -> PathReference:
        """The path at a speed that its curvature allows, and the wheel: see `next_law`."""
        turn_per_m = abs(curvature_per_m + 2.0 * path.c2_per_m)
        v_mps = sqrt(LARGEST_TURN_MPS2 / max(turn_per_m, 1e-6))
        if self._is_turned:
            v_mps = min(v_mps, self._car.speeds.resume_mps)
        if path.v_mps <= v_mps:
            return path
        return path._replace(v_mps=v_mps, a_mps2=min(path.a_mps2, 0.0))

    def _speed_after(self, under_way: Sequence[ControlInput], vx_mps: float) -> float:
        """Speed that is predicted when the inputs under way have acted."""
        pedals_mps2 = self._pedals_mps2
        for control in under_way:
            target_mps2 = pedal_mps2(control, self._car.gains)
            pedals_mps2 = lagged(pedals_mps2, target_mps2, PEDAL_LAG_S)
            vx_mps += PERIOD_S * (pedals_mps2 + self._disturbance_mps2)
        return vx_mps

    def steer_rad(
        self, state: VehicleState, curvature_per_m: float, path: PathReference, last: ControlInput
    ) -> float:
        """Wheel angle along the path, as far as the car rolls."""
        geometry, most_rad = self._car.geometry, self.largest_wheel_rad(state.vx_mps)
        largest_per_m = tan(most_rad / geometry.steering_ratio) / geometry.wheelbase_m
        curvature_per_m = path_curvature_per_m(
            state, path, curvature_per_m, geometry, largest_per_m, self._turn_error
        )
        wheel_rad = wheel_angle_rad(curvature_per_m, state.vx_mps, geometry)
        wanted_rad = min(max(wheel_rad, -most_rad), most_rad)
        largest_radps = self._car.car.limits.rate_per_s.steer_rad
        return roll_towards(wanted_rad, last.steer_rad, state.vx_mps, largest_radps)
