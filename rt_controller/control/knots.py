"""Stages of the horizon at which the inputs are planned: move blocking with a first-order hold."""

from dataclasses import dataclass
from math import ceil

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError

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
