"""The path that is followed: a request that changes at once is approached at a comfortable rate."""

from collections import deque
from math import exp

from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S

SPEED_UP_MPS2, SLOW_DOWN_MPS2, CHANGE_MPS3 = 2.0, 3.0, 6.0
"""rates towards another wanted speed beside the accelerations that are sent, and their change"""
EASE_S, REACHED_MPS = 0.7, 0.02
"""time constant of the end of such a change, and when it is over"""
ASKED_TICKS = round(0.6 / PERIOD_S)
"""an acceleration may belong to a change of speed so far ahead, as before a stop"""
ALREADY_DRIVEN_MPS = 1.0
"""a drive begins with the wanted speed if the car is so close to it, else with that of the car"""
AHEAD_S = 0.5
"""about the horizon of the controller"""
RETURN_PER_S = 3.5
"""a path that is moved sideways by 0.5 m needs 1.4 m/s^2 and 21 m/s^3 besides, for 1.8 s"""
SLOWEST_MPS = 5.0
"""a slower car takes the same distance as at this speed"""
NEGLIGIBLE = 2e-4
"""m, m/s, m/s^2"""


class FollowedPath:
    """Distance and speed that are left from a path to the one that was followed before.

    The distance returns to zero as exp(-r t) (a + b t + c t^2): place, slope and curvature of the
    followed path change steadily, also if another request arrives meanwhile.
    """

    def __init__(self) -> None:
        self._asked_mps2: deque[float] = deque(maxlen=ASKED_TICKS)
        self.begin()

    def begin(self) -> None:
        """Restart without a path."""
        self._asked_mps2.clear()
        self._speed_mps = self._rate_mps2 = 0.0
        self._a_m = self._b_mps = self._c_mps2 = 0.0

    def shift(self, step_m: float, step_mps: float = 0.0) -> None:
        """The received path moved sideways against the car: what is followed does not.

        By `step_m` at once, and by `step_mps` from now on.
        """
        self._a_m -= step_m
        self._b_mps -= RETURN_PER_S * step_m + step_mps
        self._c_mps2 -= RETURN_PER_S * (0.5 * RETURN_PER_S * step_m + step_mps)

    def move(self, moved_m: float, speed_mps: float) -> None:
        """The car moved along the road."""
        t = moved_m / max(speed_mps, SLOWEST_MPS)
        left = exp(-RETURN_PER_S * t)
        self._a_m = left * (self._a_m + t * (self._b_mps + t * self._c_mps2))
        self._b_mps = left * (self._b_mps + 2.0 * t * self._c_mps2)
        self._c_mps2 *= left
        if abs(self._a_m) + abs(self._b_mps) + abs(self._c_mps2) < NEGLIGIBLE:
            self._a_m = self._b_mps = self._c_mps2 = 0.0

    def follow(self, path: PathReference, speed_mps: float, periods: int) -> PathReference:
        """What is to be followed by a car at `speed_mps`, instead of `path`."""
        self._approach(path, speed_mps, periods * PERIOD_S)
        if self._speed_mps != path.v_mps:
            a_mps2 = path.a_mps2 + self._rate_mps2
            path = path._replace(v_mps=self._speed_mps, a_mps2=a_mps2)
        return path if self._c_mps2 == 0.0 else self._beside(path, max(speed_mps, SLOWEST_MPS))

    def _approach(self, path: PathReference, speed_mps: float, time_s: float) -> None:
        """Move the followed speed towards the wanted one."""
        if not self._asked_mps2:
            is_driven = abs(path.v_mps - speed_mps) <= ALREADY_DRIVEN_MPS
            self._speed_mps = path.v_mps if is_driven else speed_mps
        self._asked_mps2.append(path.a_mps2)
        before, most = self._speed_mps, CHANGE_MPS3 * time_s
        left_mps = path.v_mps - before
        rate = min(max(left_mps / EASE_S, -SLOW_DOWN_MPS2), SPEED_UP_MPS2)
        rate = min(max(rate, min(self._rate_mps2, 0.0) - most), max(self._rate_mps2, 0.0) + most)
        lowest = before + time_s * (min(0.0, *self._asked_mps2) + min(rate, 0.0)) - REACHED_MPS
        highest = before + time_s * (max(0.0, *self._asked_mps2) + max(rate, 0.0)) + REACHED_MPS
        if lowest <= path.v_mps <= highest:
            self._speed_mps, self._rate_mps2 = path.v_mps, 0.0
        elif left_mps > 0.0:
            self._speed_mps, self._rate_mps2 = highest - REACHED_MPS, rate
        else:
            self._speed_mps, self._rate_mps2 = lowest + REACHED_MPS, rate

    def _beside(self, path: PathReference, speed_mps: float) -> PathReference:
        """The path with the distance that is left, as a cubic that fits its next half second."""
        here, slope = self._a_m, self._b_mps - RETURN_PER_S * self._a_m
        t, left = AHEAD_S, exp(-RETURN_PER_S * AHEAD_S)
        later = left * (self._a_m + t * (self._b_mps + t * self._c_mps2))
        later_slope = left * (self._b_mps + 2.0 * t * self._c_mps2) - RETURN_PER_S * later
        length_m = t * speed_mps
        c2 = (3.0 * (later - here) - t * (2.0 * slope + later_slope)) / length_m**2
        c3 = (2.0 * (here - later) + t * (slope + later_slope)) / length_m**3
        return path._replace(
            c0_m=path.c0_m + here,
            c1=path.c1 + slope / speed_mps,
            c2_per_m=path.c2_per_m + c2,
            c3_per_m2=path.c3_per_m2 + c3,
        )
