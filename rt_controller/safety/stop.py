"""The safe stop: how it brakes beside the cornering, and the input of each mode without a plan."""

from math import inf
from typing import NamedTuple

from rt_controller.contract.braking import (
    BRAKE_RATE_N_PER_S,
    FULL_BRAKE_N,
    FULL_BRAKE_RATE_N_PER_S,
    HARD_BRAKE_N,
    HARD_BRAKE_RATE_N_PER_S,
    MOST_BRAKE_N,
    brake_beside_n,
)
from rt_controller.contract.faults import StopCause
from rt_controller.contract.limits import DEFAULT_GEOMETRY, SteeringGeometry
from rt_controller.contract.signals import ControlInput, Mode, VehicleState
from rt_controller.contract.timing import PERIOD_S


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
STEER_RETURN_RADPS = 0.7
"""40 deg/s of steering-wheel angle towards zero"""


def braking_for(
    alarm: StopCause,
    is_known: bool,
    state: VehicleState,
    steer_rad: float,
    geometry: SteeringGeometry = DEFAULT_GEOMETRY,
    stop_mps: float = inf,
    open_throttle: float = 0.0,
    force_scale: float = 1.0,
    is_held: bool = False,
) -> Braking:
    """How a safe stop brakes in this tick: beside what the tyres give to the path.

    With a lost state or path only a short stop keeps the car near its path, but it is steered there
    too.

    Args:
        alarm: of this tick; not the cause that the stop began with.
        is_known: state and path arrive and are accepted, though single signals may be estimated.
        state, steer_rad, geometry, stop_mps, open_throttle: as of `brake_beside_n`.
        force_scale: of the car's brake, see `Car`.
        is_held: the brake holds a standing car.
    """
    if is_held:
        return ALONG_PATH.scaled(force_scale)
    if alarm is StopCause.STEERING_MISMATCH:
        return FULL.scaled(min(force_scale, 1.0))
    straight = ALONG_PATH if is_known else LOST
    most_n = brake_beside_n(state, steer_rad, geometry, stop_mps, open_throttle, straight.most_n)
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
