"""The motion of the last second, which moves an earlier measurement to the present."""

from collections import deque
from math import cos, sin
from typing import NamedTuple

KEPT = 40
"""control periods: one second"""


class Motion(NamedTuple):
    """Body velocities at one instant."""

    time_ns: int
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


class MotionHistory:
    """Velocities of the last second, constant between two instants."""

    def __init__(self) -> None:
        self._motions: deque[Motion] = deque(maxlen=KEPT)

    def add(self, motion: Motion) -> None:
        """Add the present motion."""
        self._motions.append(motion)

    def turned(self, since_ns: int) -> float:
        """Change of the yaw angle from an instant to the newest motion, in rad."""
        return sum(motion.yaw_rate_radps * dt_s for motion, dt_s in self._backwards(since_ns))

    def moved(self, since_ns: int, yaw_rad: float) -> tuple[float, float]:
        """Displacement in m from an instant to the newest motion.

        Args:
            since_ns: the instant; before the oldest motion counts as the oldest.
            yaw_rad: at the newest motion, in the frame of the displacement.
        """
        x_m = y_m = 0.0
        for motion, dt_s in self._backwards(since_ns):
            middle = yaw_rad - 0.5 * motion.yaw_rate_radps * dt_s
            x_m += dt_s * (motion.vx_mps * cos(middle) - motion.vy_mps * sin(middle))
            y_m += dt_s * (motion.vx_mps * sin(middle) + motion.vy_mps * cos(middle))
            yaw_rad -= motion.yaw_rate_radps * dt_s
        return x_m, y_m

    def _backwards(self, since_ns: int) -> list[tuple[Motion, float]]:
        """Each motion and for how long it lasted after `since_ns`, the newest first.

        The motion between two samples is taken as that of the later one.
        """
        parts: list[tuple[Motion, float]] = []
        for k in range(len(self._motions) - 1, -1, -1):
            motion = self._motions[k]
            begin_ns = self._motions[k - 1].time_ns if k > 0 else since_ns
            begin_ns = max(begin_ns, since_ns)
            if motion.time_ns <= begin_ns:
                break
            parts.append((motion, 1e-9 * (motion.time_ns - begin_ns)))
        return parts
