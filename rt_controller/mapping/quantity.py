"""What a signal measures, and the limits of that quantity in a road vehicle."""

from enum import StrEnum
from math import inf
from typing import NamedTuple


class Quantity(StrEnum):
    """Physical quantity of a signal, as far as the checks use it."""

    SPEED = "speed"
    LATERAL_SPEED = "lateral speed"
    YAW_RATE = "yaw rate"
    STEERING = "steering"
    """of the steering wheel or of the road wheels"""
    DRIVE = "drive"
    """throttle, force or torque; positive values accelerate"""
    BRAKE = "brake"
    """pedal, force or pressure; positive values decelerate"""
    LONGITUDINAL_ACCELERATION = "longitudinal acceleration"
    LATERAL_ACCELERATION = "lateral acceleration"
    """of an accelerometer, positive to the front and to the left"""
    OTHER = "other"


class Limits(NamedTuple):
    """Values and rates of change that no road vehicle exceeds, in SI."""

    low: float = -inf
    high: float = inf
    steepest_per_s: float = inf


_LIMITS = {
    (Quantity.SPEED, "m/s"): Limits(-20.0, 120.0, 60.0),
    (Quantity.LATERAL_SPEED, "m/s"): Limits(-30.0, 30.0, 60.0),
    (Quantity.YAW_RATE, "rad/s"): Limits(-5.0, 5.0, 60.0),
    (Quantity.STEERING, "rad"): Limits(-20.0, 20.0, 60.0),
    (Quantity.DRIVE, "1"): Limits(-1.05, 1.05),
    (Quantity.DRIVE, "N"): Limits(-4e5, 4e5),
    (Quantity.BRAKE, "1"): Limits(-0.05, 1.05),
    (Quantity.BRAKE, "N"): Limits(-4e5, 4e5),
    (Quantity.BRAKE, "Pa"): Limits(-1e6, 4e7),
}
"""Lower limits below zero allow for sensor offsets and for reversing."""

_QUANTITIES = {
    "vx_mps": Quantity.SPEED,
    "vy_mps": Quantity.LATERAL_SPEED,
    "yaw_rate_radps": Quantity.YAW_RATE,
    **dict.fromkeys(("steer_rad", "road_wheel_rad"), Quantity.STEERING),
    **dict.fromkeys(("throttle", "force_n"), Quantity.DRIVE),
    **dict.fromkeys(("brake", "brake_n", "brake_pa"), Quantity.BRAKE),
    "ax_mps2": Quantity.LONGITUDINAL_ACCELERATION,
    "ay_mps2": Quantity.LATERAL_ACCELERATION,
}


def quantity_of_name(name: str) -> Quantity:
    """Quantity of a signal with this name, for signals whose mapping does not give one."""
    return _QUANTITIES.get(name, Quantity.OTHER)


def limits_of(quantity: Quantity, unit: str) -> Limits:
    """Limits of the quantity in this SI unit; infinite ones if there are none."""
    return _LIMITS.get((quantity, unit), Limits())
