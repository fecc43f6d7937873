"""Bounds and slew rates of the control inputs, for data, plan and envelope; range of friction."""

from math import radians
from typing import NamedTuple

from rt_controller.contract.signals import ControlInput


class InputLimits(NamedTuple):
    """Lowest and highest input, and the largest change of each per second."""

    lower: ControlInput
    upper: ControlInput
    rate_per_s: ControlInput


INPUT_LIMITS = InputLimits(
    lower=ControlInput(throttle=0.0, brake_n=0.0, steer_rad=-radians(40.0)),
    upper=ControlInput(throttle=1.0, brake_n=150.0, steer_rad=radians(40.0)),
    rate_per_s=ControlInput(throttle=2.5, brake_n=500.0, steer_rad=radians(200.0)),
)
"""The paper's bounds; the rates are this project's choice for "limited to realistic driving"."""

RELEASED_THROTTLE, RELEASED_BRAKE_N = 1e-3, 0.15
"""below these a pedal counts as released: one thousandth of its travel"""

LEAST_FRICTION, MOST_FRICTION = 0.05, 1.5
"""of a road; 1 is the road of the tyre test"""

PEDAL_CHANGE_S = 0.15
"""time to move the foot from one pedal to the other"""
