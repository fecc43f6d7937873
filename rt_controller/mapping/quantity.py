"""What a signal measures, the limits of that quantity in a road vehicle, and units in names."""

from enum import StrEnum
from typing import NamedTuple

from rt_controller.mapping.units import is_si, unit_of_name


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

    low: float
    high: float
    steepest_per_s: float


_NO_LIMITS = Limits(float("-inf"), float("inf"), float("inf"))

_LIMITS = {
    (Quantity.SPEED, "m/s"): Limits(-20.0, 120.0, 60.0),
    (Quantity.LATERAL_SPEED, "m/s"): Limits(-30.0, 30.0, 60.0),
    (Quantity.YAW_RATE, "rad/s"): Limits(-5.0, 5.0, 60.0),
    (Quantity.STEERING, "rad"): Limits(-20.0, 20.0, 60.0),
    (Quantity.DRIVE, "1"): Limits(-1.05, 1.05, float("inf")),
    (Quantity.DRIVE, "N"): Limits(-4e5, 4e5, float("inf")),
    (Quantity.BRAKE, "1"): Limits(-0.05, 1.05, float("inf")),
    (Quantity.BRAKE, "N"): Limits(-4e5, 4e5, float("inf")),
    (Quantity.BRAKE, "Pa"): Limits(-1e6, 4e7, float("inf")),
}
"""Lower limits below zero allow for sensor offsets and for reversing."""

_NAMES = {
    Quantity.SPEED: ("vx_mps",),
    Quantity.LATERAL_SPEED: ("vy_mps",),
    Quantity.YAW_RATE: ("yaw_rate_radps",),
    Quantity.STEERING: ("steer_rad", "road_wheel_rad"),
    Quantity.DRIVE: ("throttle", "force_n"),
    Quantity.BRAKE: ("brake", "brake_n", "brake_pa"),
    Quantity.LONGITUDINAL_ACCELERATION: ("ax_mps2",),
    Quantity.LATERAL_ACCELERATION: ("ay_mps2",),
}


def quantity_of_name(name: str) -> Quantity:
    """Quantity of a signal with this name, for signals whose mapping does not give one."""
    fits = (quantity for quantity, names in _NAMES.items() if name in names)
    return next(fits, Quantity.OTHER)


def limits_of(quantity: Quantity, unit: str) -> Limits:
    """Limits of the quantity in this SI unit; infinite ones if there are none."""
    return _LIMITS.get((quantity, unit), _NO_LIMITS)


def si_unit_of_name(name: str) -> str | None:
    """The SI unit that a name ends in; None if in none; `ValueError` if in one outside SI."""
    unit = unit_of_name(name)
    if unit is not None and not is_si(unit):
        raise ValueError(
            f"{name}: expected a name that ends in an SI unit, found {name.rpartition('_')[2]!r}. "
            f"Data sets are in SI: use such a name (for example vx_mps, yaw_rate_radps, "
            f"steer_rad), and give the log's unit in `unit`"
        )
    return unit
