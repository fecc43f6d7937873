"""Terms of eq. (14): the deviations that an engineer tolerates, and the bounds of the inputs."""

from typing import Literal, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS, InputLimits
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import Knots

Heading = Literal["course", "epsi"]


class TrackingCost(NamedTuple):
    """Deviations that each cost one unit (Bryson's rule): a weight is 1 / tolerance^2.

    An infinite tolerance is a weight of zero.
    """

    state: VehicleState
    """tolerated deviation from the reference at one stage"""
    control: ControlInput
    """tolerated size of an input: R of eq. (14)"""
    control_change: ControlInput
    """tolerated change of an input from one period to the next"""
    terminal_factor: float = 1.0
    """Q_N = terminal_factor * Q"""
    heading: Heading = "course"
    """which angle follows the direction of the path, with the tolerance of epsi_rad"""


class Corridor(NamedTuple):
    """Soft bounds on the distance from the path."""

    half_width_m: float
    beyond_m: float
    """excess that costs as much as a tolerated deviation of a state"""

    @property
    def weight(self) -> float:
        return 1.0 / self.beyond_m**2


class InputBounds(NamedTuple):
    """lower <= v <= upper and -slew <= v_j - v_(j-1) <= slew for the inputs v at the knots.

    All (K, 3); v = u / scale are the inputs in units of their ranges.
    """

    scale: Array
    lower: Array
    upper: Array
    slew: Array
    """largest change since the knot before; at the first one since the input of the last period"""


def bound_inputs(knots: Knots, limits: InputLimits = INPUT_LIMITS) -> InputBounds:
    """Bounds of the inputs at the knots. Paper: eq. (14), with slew rates added."""
    lower, upper = np.array(limits.lower), np.array(limits.upper)
    range_ = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)
    per_period = np.array(limits.rate_per_s) * PERIOD_S / range_
    rows = range_, lower / range_, upper / range_, per_period
    scale, lower, upper, slew = (np.tile(row, (knots.count, 1)) for row in rows)
    slew[1:] *= knots.intervals[:-1, None]
    return InputBounds(scale, lower, upper, slew)
