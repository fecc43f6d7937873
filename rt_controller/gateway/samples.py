"""Newest samples of the car's signals, and histories of motion and wanted speed."""

from collections import deque
from collections.abc import Mapping, Sequence
from math import cos, isfinite, isnan, sin
from typing import NamedTuple

from rt_controller.contract.timing import PERIOD_S
from rt_controller.mapping.car_file import Source
from rt_controller.mapping.slots import Slot
from rt_controller.mapping.tables import LONGEST_GAP_PERIODS

LONGEST_GAP_S = 0.1
"""of a message without a cycle time"""
SLOPE_WINDOW_S, LARGEST_MPS2 = 0.5, 3.0
"""of the wanted speed"""


class Sample(NamedTuple):
    """One value in SI, and when it was measured; NaN: the car sent none that may be used."""

    value: float
    measured_ns: int


class Samples:
    """The newest samples; one that is older than its longest gap is missing."""

    def __init__(self, slots: Sequence[Slot], sources: Mapping[str, Source]) -> None:
        self._newest: dict[str, tuple[Sample, int]] = {}
        self._known: dict[str, tuple[float, int]] = {}
        self._delay_ns = {each.name: round(1e9 * each.column.delay_s) for each in slots}
        gaps_s = {each.name: longest_gap_s(each, sources[each.name]) for each in slots}
        self._gap_ns = {name: round(1e9 * gap_s) for name, gap_s in gaps_s.items()}

    def add(self, values: Mapping[str, float], arrival_ns: int) -> None:
        """Add the values of one frame, by slot."""
        for name, value in values.items():
            sample = Sample(value, arrival_ns - self._delay_ns[name])
            self._newest[name] = sample, arrival_ns
            if not isnan(value):
                self._known[name] = value, arrival_ns

    def newest(self, name: str, now_ns: int) -> Sample | None:
        """The newest sample of a slot; None: not mapped, none yet, or too old."""
        found = self._newest.get(name)
        if found is None or now_ns - found[1] > self._gap_ns[name]:
            return None
        return found[0]

    def has(self, name: str) -> bool:
        """True if the slot is mapped."""
        return name in self._gap_ns

    def is_on(self, name: str, now_ns: int) -> bool | None:
        """Whether a slot of 0 or 1 is on; None: not known.

        A value that is no measurement is bridged as a sample that is lost.
        """
        found = self._known.get(name)
        if found is None or now_ns - found[1] > self._gap_ns[name]:
            return None
        return found[0] > 0.5


def longest_gap_s(slot: Slot, source: Source) -> float:
    """Time without a new sample after which a slot is missing."""
    if slot.column.longest_gap_s is not None:
        return slot.column.longest_gap_s
    cycle_ms = source.message.cycle_time
    if not cycle_ms:
        return LONGEST_GAP_S
    return max(LONGEST_GAP_PERIODS * 1e-3 * cycle_ms, 2.0 * PERIOD_S)


class Motion(NamedTuple):
    """Body velocities at one instant."""

    time_ns: int
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


class MotionHistory:
    """Velocities of the last second, constant between two instants."""

    def __init__(self) -> None:
        self._motions: deque[Motion] = deque(maxlen=round(1.0 / PERIOD_S))

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
        motions = list(self._motions)
        for k in range(len(motions) - 1, -1, -1):
            begin_ns = max(motions[k - 1].time_ns if k else since_ns, since_ns)
            if motions[k].time_ns <= begin_ns:
                break
            parts.append((motions[k], 1e-9 * (motions[k].time_ns - begin_ns)))
        return parts


class SpeedSlope:
    """Slope of the wanted speed over the last half second, of a car that sends none.

    The window is longer than the cycle of most messages: a speed that changes in steps has a
    smooth slope.
    """

    def __init__(self) -> None:
        self._speeds: deque[tuple[int, float]] = deque(maxlen=round(SLOPE_WINDOW_S / PERIOD_S) + 1)

    def mps2(self, speed_mps: float, now_ns: int) -> float:
        """The slope with the speed of this period; 0 in the first one, and of a speed that is NaN.

        A gap of the window or longer, or a NaN, begins a new slope.
        """
        speeds = self._speeds
        if not isfinite(speed_mps) or (speeds and now_ns - speeds[-1][0] > SLOPE_WINDOW_S * 1e9):
            speeds.clear()
        if not isfinite(speed_mps):
            return 0.0
        speeds.append((now_ns, speed_mps))
        first_ns, first_mps = speeds[0]
        if now_ns == first_ns:
            return 0.0
        slope_mps2 = (speed_mps - first_mps) / (1e-9 * (now_ns - first_ns))
        return min(max(slope_mps2, -LARGEST_MPS2), LARGEST_MPS2)
