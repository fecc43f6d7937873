"""Terms of eq. (14): tolerated deviations, the knots of the inputs, and their bounds.

Between the knots the inputs are straight lines (move blocking with a first-order hold).
"""

from dataclasses import dataclass
from math import ceil
from typing import Literal, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS, InputLimits
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S

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


LONGEST_WITHOUT_BLOCKS = 20
"""periods of a horizon with one knot in each"""


@dataclass(frozen=True, slots=True)
class Knots:
    """Stages at which the values of the inputs are planned; between them they are straight lines.

    The interval from each knot to the next one, or to the end of the horizon, is one in which the
    cost counts the state at its end.
    """

    stages: tuple[int, ...]
    """of the K knots, ascending, the first 0"""
    horizon: int
    """N, in periods"""

    @property
    def count(self) -> int:
        return len(self.stages)

    @property
    def ends(self) -> tuple[int, ...]:
        """Of the K intervals."""
        return (*self.stages[1:], self.horizon)

    @property
    def intervals(self) -> Array:
        """(K,) their lengths in periods."""
        return np.diff((*self.stages, self.horizon)).astype(np.float64)

    @property
    def unit(self) -> int:
        """2 if all intervals are even, otherwise 1."""
        return 1 if any(end % 2 for end in self.ends) else 2

    @property
    def interpolation(self) -> Array:
        """(N, K), from the inputs at the knots to those of all stages; constant after the last."""
        hats = [np.interp(np.arange(self.horizon), self.stages, row) for row in np.eye(self.count)]
        return np.stack(hats, axis=1)


def place_knots(horizon: int, count: int | None = None) -> Knots:
    """`count` knots over `horizon` periods: intervals of two periods first, then of four.

    As many as periods: one at each stage. None: so many up to `LONGEST_WITHOUT_BLOCKS`, and about a
    third of a longer horizon.

    Raises:
        ConfigError: the numbers do not fit each other.
    """
    if count is None:
        is_blocked = horizon > LONGEST_WITHOUT_BLOCKS and horizon % 2 == 0
        count = ceil(0.35 * horizon) if is_blocked else horizon
    if count == horizon:
        return Knots(tuple(range(horizon)), horizon)
    long = horizon // 2 - count
    if horizon % 2 or not 0 <= long <= count:
        raise ConfigError(
            f"`mpc.knots` {count}: expected as many as `mpc.horizon` {horizon}, or, of an even "
            f"horizon, a quarter to a half of it."
        )
    lengths = [2] * (count - long) + [4] * long
    return Knots(tuple(np.cumsum([0, *lengths[:-1]]).tolist()), horizon)


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
