"""What flows between the packages: order, names and units of every vector.

The `_fields` of these tuples are the vector order everywhere: in arrays, in the model
bundle and on the bus. SI units; the unit is the end of each name.
Paper: eq. (2), "set of states and inputs".
"""

from enum import IntEnum
from typing import NamedTuple


class VehicleState(NamedTuple):
    """The car in the Frenet frame of its road, sampled once a period."""

    vx_mps: float
    """longitudinal velocity of the centre of gravity, body axes"""
    vy_mps: float
    """lateral velocity of the centre of gravity, body axes, positive to the left"""
    yaw_rate_radps: float
    """yaw rate, positive counter-clockwise"""
    ds_m: float
    """backward progress along the road, s_k - s_(k-1)"""
    ey_m: float
    """lateral deviation from the road's reference line, positive to the left"""
    epsi_rad: float
    """heading relative to the tangent of the reference line"""


class ControlInput(NamedTuple):
    """What the driver's hands and feet do: held constant over one period."""

    throttle: float
    """accelerator pedal, 0..1"""
    brake_n: float
    """brake pedal force"""
    steer_rad: float
    """steering *wheel* angle, positive to the left"""


NEUTRAL_INPUT = ControlInput(throttle=0.0, brake_n=0.0, steer_rad=0.0)
"""feet off, wheel straight"""


class PathReference(NamedTuple):
    """The path ahead, as the lane polynomial of a camera, in road coordinates.

    The wanted lateral deviation at arc length sigma ahead of the car is
    e_y(sigma) = c0 + c1 sigma + c2 sigma^2 + c3 sigma^3; the wanted speed t seconds ahead
    is v + a t.
    """

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float
    v_mps: float
    a_mps2: float


class Mode(IntEnum):
    """What the controller is doing; travels in ACT_CMD and CTRL_HB."""

    STANDBY = 0
    """no mission: pedals released, wheel eased to the middle"""
    NOMINAL = 1
    """the plan of this tick drives"""
    HOLD_PLAN = 2
    """the next input of the last good plan drives"""
    SAFE_STOP = 3
    """throttle closed, brake ramped; left only on an explicit request"""


STATE_UNITS = ("m/s", "m/s", "rad/s", "m", "m", "rad")
INPUT_UNITS = ("1", "N", "rad")
EXOGENOUS_FIELDS = ("curvature_per_m",)
EXOGENOUS_UNITS = ("1/m",)
