"""What a signal measures, where the checks know something about that kind of signal."""

from enum import StrEnum
from typing import NamedTuple


class Quantity(StrEnum):
    """What a signal measures."""

    SPEED = "speed"
    LATERAL_SPEED = "lateral speed"
    YAW_RATE = "yaw rate"
    STEERING = "steering"
    """of the steering wheel or of the road wheels"""
    DRIVE = "drive"
    """throttle, force or torque: more of it, more speed"""
    BRAKE = "brake"
    """pedal, force or pressure: more of it, less speed"""
    OTHER = "other"


class Limits(NamedTuple):
    """What no road vehicle goes beyond."""

    low: float
    high: float
    steepest_per_s: float


_ANY = Limits(float("-inf"), float("inf"), float("inf"))

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
"""Lows below zero leave room for sensors' offsets, and for reversing."""

_KNOWN_NAMES = {
    "vx_mps": Quantity.SPEED,
    "vy_mps": Quantity.LATERAL_SPEED,
    "yaw_rate_radps": Quantity.YAW_RATE,
    "steer_rad": Quantity.STEERING,
    "road_wheel_rad": Quantity.STEERING,
    "throttle": Quantity.DRIVE,
    "force_n": Quantity.DRIVE,
    "brake": Quantity.BRAKE,
    "brake_n": Quantity.BRAKE,
    "brake_pa": Quantity.BRAKE,
}


def quantity_of_name(name: str) -> Quantity:
    """What a signal of this name measures, if nobody says otherwise."""
    return _KNOWN_NAMES.get(name, Quantity.OTHER)


def limits_of(quantity: Quantity, unit: str) -> Limits:
    """What signals of that kind, in that SI unit, do not go beyond."""
    return _LIMITS.get((quantity, unit), _ANY)
