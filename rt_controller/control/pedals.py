"""Choice of the pedal: throttle and brake are never pressed together.

"Throttle times brake is zero" is not convex. So one pedal is chosen before the QP is solved, and
the upper bound of the other one falls to zero at its slew rate.
"""

from collections.abc import Sequence
from enum import IntEnum
from math import ceil

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import PEDAL_CHANGE_S
from rt_controller.contract.signals import ControlInput, InputColumn
from rt_controller.contract.timing import PERIOD_S


class Pedal(IntEnum):
    """The pedal that the plan may press; the value is its index in `ControlInput`."""

    THROTTLE = InputColumn.throttle
    BRAKE = InputColumn.brake_n


CHANGE_MPS2 = 0.25
"""acceleration beyond that of released pedals for which the other pedal is taken: the hysteresis"""

CHANGE_TICKS = round(PEDAL_CHANGE_S / PERIOD_S)


class PedalChoice:
    """The pedal in use, with hysteresis, and the periods left until it can be pressed."""

    def __init__(self) -> None:
        self.pedal = Pedal.THROTTLE
        self.ticks_until_pressed = 0

    def update(self, needed_mps2: float) -> None:
        """Choose for this period.

        `needed_mps2`: wanted acceleration less that of the car with both pedals released.
        """
        if self.ticks_until_pressed > 0:
            self.ticks_until_pressed -= 1
        if self.pedal is Pedal.THROTTLE and needed_mps2 < -CHANGE_MPS2:
            self._change_to(Pedal.BRAKE)
        elif self.pedal is Pedal.BRAKE and needed_mps2 > CHANGE_MPS2:
            self._change_to(Pedal.THROTTLE)

    def resume(self, previous: ControlInput) -> None:
        """Continue after another law, with the pedal that is pressed in `previous`."""
        self.pedal = Pedal.BRAKE if previous.brake_n > 0.0 else Pedal.THROTTLE
        self.ticks_until_pressed = 0

    def _change_to(self, pedal: Pedal) -> None:
        self.pedal = pedal
        self.ticks_until_pressed = CHANGE_TICKS


def limit_pedals(
    upper: Array,
    periods: NDArray[np.int64],
    choice: PedalChoice,
    previous: Array,
    slew: Array,
    most: Sequence[float] | Array = (1.0, 1.0),
) -> None:
    """Set the upper bounds of both pedals at the knots of the horizon, in place.

    `upper` (K, 3), `previous` (3,) the input of the last period and `slew` (3,) its largest change
    in one period, and `most` the bounds of both pedals, all in units of the inputs' ranges;
    `periods` (K,) from the last one to the knot. A pedal beyond its bound is released at its rate.
    """
    pressed = choice.pedal
    released = Pedal.BRAKE if pressed is Pedal.THROTTLE else Pedal.THROTTLE
    upper[:, pressed] = most[pressed]
    if previous[pressed] > most[pressed]:
        upper[:, pressed] = np.maximum(previous[pressed] - slew[pressed] * periods, most[pressed])
    upper[:, released] = 0.0
    if previous[released] > 0.0:
        upper[:, released] = np.maximum(previous[released] - slew[released] * periods, 0.0)
    if previous[pressed] <= 0.0:
        release_ticks = ceil(previous[released] / slew[released] - 1e-6)
        wait = max(release_ticks, choice.ticks_until_pressed)
        upper[periods <= wait, pressed] = 0.0
