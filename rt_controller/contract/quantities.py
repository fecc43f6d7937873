"""The quantities of the plausibility checks; `safety/checks.py` has their thresholds."""

from enum import IntEnum, auto


class Quantity(IntEnum):
    """What a check compares with its threshold; index into the values of one tick.

    A car may set a threshold by the lower-case name.
    """

    PROGRESS_STEP_M = 0
    """|Δs - progress computed from v_x, v_y, e_psi, e_y| of one period"""
    PROGRESS_SPEED_MPS = auto()
    """|low-pass of v_x - Δs / period|: both on a straight road"""
    SPEED_STEP_MPS = auto()
    """|v_x - v_x predicted by the model one period ago|; without a model: the last v_x"""
    SPEED_TEN_MPS = auto()
    """|v_x - v_x predicted ten periods ago with the inputs that were applied|"""
    LATERAL_SPEED_STEP_MPS = auto()
    LATERAL_SPEED_TEN_MPS = auto()
    YAW_RATE_STEP_RADPS = auto()
    YAW_RATE_TEN_RADPS = auto()
    HEADING_RAD = auto()
    """|e_psi - e_psi integrated from yaw rate, curvature and progress|"""
    LATERAL_ERROR_M = auto()
    """|e_y - e_y integrated from v_x, e_psi and v_y|"""
    CURVATURE_STEP_PER_M = auto()
    """|curvature - the value ahead that was sent before for this place|; a large one less 1.5 times
    the changes of the values ahead"""
    PEDAL_SPEED_MPS = auto()
    """speed that the pedals should have added to a slow car, and that is not measured; scaled to a
    car that accelerates by 6 m/s^2 with an open throttle"""
    FROZEN_TICKS = auto()
    """ticks in which all six states are constant, although by the other states or the model they
    change"""
    STEERING_RAD = auto()
    """distance of ACT_FB from the range of the commands of the last 150 ms"""
    THROTTLE = auto()
    BRAKE_N = auto()
    TRACKING_M = auto()
    """|e_y - c0|"""
    SPEED_MPS = auto()
    """|v_x - wanted speed|"""
    OUTSIDE_TRAINING = auto()
    """largest of speed, lateral acceleration, wheel and perhaps curvature, relative to what the
    model was trained with at this speed; 0: none is outside"""
    PATH_STEP_M = auto()
    """|c0 - the value that the path before had at this place|"""
    PATH_DRIFT_M = auto()
    """the same, summed up with a memory of 2 s"""
    PATH_FROZEN_M = auto()
    """by how much a path that repeats itself should have changed: at the car, and 10 m ahead"""
    PATH_TURN_RAD = auto()
    """|c1 - the slope that the path before had at this place|"""
    PATH_SPEED_STEP_MPS = auto()
    """wanted speed - the one before; 0 if it falls"""
    PREVIEW_STEP_PER_M = auto()
    """the largest difference of the curvature ahead to the one sent before, as above"""
    PATH_LATERAL_MPS2 = auto()
    """largest lateral acceleration along the path over the next half second"""
    ENGAGE_EY_M = auto()
    """farthest distance from the path of a car that the controller is to take over"""
    ENGAGE_EPSI_RAD = auto()
    """|e_psi - heading of the path| of such a car"""

    @property
    def unit(self) -> str:
        """By the end of its name."""
        return next((unit for end, unit in _UNITS.items() if self.name.endswith(f"_{end}")), "1")


_UNITS = {
    "PER_M": "1/m",
    "M": "m",
    "MPS": "m/s",
    "MPS2": "m/s^2",
    "RAD": "rad",
    "RADPS": "rad/s",
    "N": "N",
    "TICKS": "ticks",
}
"""by the end of a name, the longer one first"""
