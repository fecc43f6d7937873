"""A foot that holds the speed, and hands that turn the steering wheel by the clock."""

from collections.abc import Callable
from dataclasses import dataclass

from rt_controller.contract.signals import ControlInput
from sim_bridge.validation.run import Moment

_THROTTLE_PER_MPS = 0.5
_THROTTLE_PER_M = 0.3


class SpeedHold:
    """A foot that holds a speed with the throttle alone."""

    def __init__(self, speed_mps: float, throttle: float, period_s: float) -> None:
        self._speed_mps = speed_mps
        self._held = throttle
        self._period_s = period_s

    def throttle(self, vx_mps: float) -> float:
        """The throttle of the next period; to be asked once a period."""
        slower_mps = self._speed_mps - vx_mps
        self._held = min(1.0, max(0.0, self._held + _THROTTLE_PER_M * slower_mps * self._period_s))
        return min(1.0, max(0.0, self._held + _THROTTLE_PER_MPS * slower_mps))


@dataclass(frozen=True, slots=True)
class OpenLoopDriver:
    """Steers by the clock and holds the speed."""

    steer_rad: Callable[[float], float]
    foot: SpeedHold

    def __call__(self, now: Moment) -> ControlInput:
        return ControlInput(self.foot.throttle(now.vx_mps), 0.0, self.steer_rad(now.time_s))
