"""Which pedal may be used: one foot cannot press both, and a convex QP cannot say so.

"Throttle times brake is zero" is not convex. So one pedal is chosen before the QP is solved, and
the other one's ceiling comes down to zero as fast as its slew rate allows.
"""

from enum import IntEnum
from math import ceil

import numpy as np

from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import PEDAL_CHANGE_S
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S


class Pedal(IntEnum):
    """The pedal that the plan may press: its place in `ControlInput`."""

    THROTTLE = ControlInput._fields.index("throttle")
    BRAKE = ControlInput._fields.index("brake_n")


BRAKE_ABOVE_MPS = 1.0
"""faster than wanted by this much: engine drag alone will not do"""
THROTTLE_BELOW_MPS = 0.2
BRAKE_BELOW_MPS2 = -0.6
"""a wanted deceleration beyond what a closed throttle gives"""
THROTTLE_ABOVE_MPS2 = -0.3

_CHANGE_TICKS = round(PEDAL_CHANGE_S / PERIOD_S)


class PedalChoice:
    """The pedal in use, with hysteresis, and the ticks a foot still needs to reach it."""

    def __init__(self) -> None:
        self.pedal = Pedal.THROTTLE
        self.ticks_until_pressed = 0

    def update(self, speed_error_mps: float, wanted_mps2: float) -> None:
        """Choose for this tick; `speed_error_mps` is the speed minus the wanted one."""
        if self.ticks_until_pressed > 0:
            self.ticks_until_pressed -= 1
        brake = speed_error_mps > BRAKE_ABOVE_MPS or wanted_mps2 < BRAKE_BELOW_MPS2
        throttle = speed_error_mps < THROTTLE_BELOW_MPS and wanted_mps2 > THROTTLE_ABOVE_MPS2
        if self.pedal is Pedal.THROTTLE and brake:
            self._change_to(Pedal.BRAKE)
        elif self.pedal is Pedal.BRAKE and throttle:
            self._change_to(Pedal.THROTTLE)

    def _change_to(self, pedal: Pedal) -> None:
        self.pedal = pedal
        self.ticks_until_pressed = _CHANGE_TICKS


def lower_ceilings(ceilings: Array, choice: PedalChoice, start: Array, slew: Array) -> None:
    """Set the pedals' upper bounds over the horizon, in place.

    `ceilings` (N, 3), `start` (3,) the previous input and `slew` (3,) its largest change in one
    period, all in units of the inputs' ranges.
    """
    pressed = choice.pedal
    released = Pedal.BRAKE if pressed is Pedal.THROTTLE else Pedal.THROTTLE
    ceilings[:, pressed] = 1.0
    ceilings[:, released] = 0.0
    if start[released] > 0.0:  # the foot comes up
        periods = np.arange(1, ceilings.shape[0] + 1)
        ceilings[:, released] = np.maximum(start[released] - slew[released] * periods, 0.0)
    if start[pressed] <= 0.0:  # the foot is still on its way
        release_ticks = ceil(start[released] / slew[released] - 1e-9)
        ceilings[: max(release_ticks, choice.ticks_until_pressed), pressed] = 0.0
