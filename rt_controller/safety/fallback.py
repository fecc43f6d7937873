"""The input of each mode: the plan, or what is sent when no plan may be followed."""

from math import radians
from typing import NamedTuple

from rt_controller.contract.faults import StopCause
from rt_controller.contract.limits import (
    BRAKE_RATE_N_PER_S,
    FULL_BRAKE_N,
    FULL_BRAKE_RATE_N_PER_S,
    HARD_BRAKE_N,
    HARD_BRAKE_RATE_N_PER_S,
    LEAST_BRAKE_N,
    MOST_BRAKE_N,
    brake_beside_n,
)
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.coast_model import Cornering


class Braking(NamedTuple):
    """How a safe stop brakes."""

    most_n: float
    rate_n_per_s: float

    def scaled(self, by: float) -> "Braking":
        """The same deceleration, of a car whose brake needs `by` times the force."""
        return self if by == 1.0 else Braking(by * self.most_n, by * self.rate_n_per_s)


ALONG_PATH = Braking(MOST_BRAKE_N, BRAKE_RATE_N_PER_S)
"""as the watchdog of the vehicle"""
LOST = Braking(HARD_BRAKE_N, HARD_BRAKE_RATE_N_PER_S)
"""the last known path is only some metres long, and the error of an estimated place grows"""
FULL = Braking(FULL_BRAKE_N, FULL_BRAKE_RATE_N_PER_S)
"""with a stuck wheel only the brake still acts"""
COUNTER_STEERING = Braking(20.0, 150.0)
"""of a car that turns less or more than its wheel: its tyres need their grip for the path, with ice
under one side for example"""
COUNTER_STEERING_RAD = radians(10.0)
"""difference of the wheel from that of a steady turn, from which on this holds"""
STEER_RETURN_RADPS = 0.7
"""40 deg/s of steering-wheel angle towards zero"""


def braking_for(
    alarm: StopCause,
    is_known: bool,
    cornering: Cornering,
    open_throttle: float = 0.0,
    force_scale: float = 1.0,
    is_held: bool = False,
) -> Braking:
    """How a safe stop brakes in this tick: beside what the tyres give to the path.

    A wheel that has an offset, but moves, is corrected by the vehicle: from then on the tyres need
    their grip for the path again. With a lost state or path only a short stop keeps the car near
    its path, but it is steered there too.

    Args:
        alarm: of this tick; not the cause that the stop began with.
        is_known: state and path arrive and are accepted, though single signals may be estimated.
        cornering: of the car in this tick.
        open_throttle: by which the throttle is open against its command.
        force_scale: of the car's brake, see `Car`.
        is_held: the brake holds a standing car.
    """
    if is_held:
        return ALONG_PATH.scaled(force_scale)
    if alarm is StopCause.STEERING_MISMATCH:
        return FULL.scaled(min(force_scale, 1.0))
    if is_known and abs(cornering.counter_steering_rad) > COUNTER_STEERING_RAD:
        most_n = COUNTER_STEERING.most_n + max(cornering.least_brake_n - LEAST_BRAKE_N, 0.0)
        return COUNTER_STEERING._replace(most_n=most_n).scaled(force_scale)
    straight = ALONG_PATH if is_known else LOST
    most_n = brake_beside_n(
        cornering.lateral_mps2,
        cornering.wanted_mps2,
        open_throttle,
        straight.most_n,
        cornering.least_brake_n,
    )
    return Braking(most_n, straight.rate_n_per_s).scaled(force_scale)


def input_for(
    mode: Mode,
    planned: ControlInput | None,
    previous: ControlInput,
    is_held: bool,
    braking: Braking = ALONG_PATH,
    wheel_rad: float | None = None,
) -> ControlInput:
    """The input that is sent in `mode`.

    Args:
        mode: of this tick.
        planned: that of the last good plan, if it has one.
        previous: input of the last period.
        is_held: True if the brake holds a standing car, by the last law that was chosen.
        braking: of a safe stop.
        wheel_rad: angle to which somebody else has turned the wheel; None: not known.
    """
    if mode is Mode.STANDBY:
        return stand_by(previous, wheel_rad)
    if mode is Mode.SAFE_STOP or planned is None:
        return safe_stop(previous, planned, is_held, braking)
    return planned


def stand_by(previous: ControlInput, wheel_rad: float | None = None) -> ControlInput:
    """Input of one period of standby: pedals released, steering at the wheel or towards zero."""
    if wheel_rad is None:
        wheel_rad = _towards_zero(previous.steer_rad)
    return ControlInput(throttle=0.0, brake_n=0.0, steer_rad=wheel_rad)


def safe_stop(
    previous: ControlInput,
    planned: ControlInput | None,
    is_held: bool,
    braking: Braking = ALONG_PATH,
) -> ControlInput:
    """Input of one period of the safe stop: throttle closed, brake ramped, steering on the path.

    The steering follows the last good plan: a constant wheel angle in the middle of a lane change
    would leave the road. Without a plan it returns to zero. The brake of a car that is held may be
    pressed further than that of a stopping car, and is not released.
    """
    brake_n = min(previous.brake_n + braking.rate_n_per_s * PERIOD_S, braking.most_n)
    if is_held:
        brake_n = max(brake_n, previous.brake_n, brake_n if planned is None else planned.brake_n)
    steer_rad = _towards_zero(previous.steer_rad) if planned is None else planned.steer_rad
    return ControlInput(throttle=0.0, brake_n=brake_n, steer_rad=steer_rad)


def _towards_zero(steer_rad: float) -> float:
    change = STEER_RETURN_RADPS * PERIOD_S
    return steer_rad - min(max(steer_rad, -change), change)
