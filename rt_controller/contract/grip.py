"""Lateral acceleration of a path, and brake force that leaves the tyres grip to steer."""

from rt_controller.contract.limits import INPUT_LIMITS

MOST_LATERAL_MPS2 = 8.5
"""that a path may need at its wanted speed: what a car can do on a dry road"""
AHEAD_S, NEAR, FAR = 0.5, 0.2113, 0.7887
"""time ahead over which a path is compared with it, about the horizon of the controller, and the
places in it. These are the Gauss points: there a fitted cubic has about the curvature of its path,
at its ends up to 1.5 times as much"""
MOST_BRAKE_N, BRAKE_RATE_N_PER_S = 75.0, 150.0
"""of a straight car, about 0.4 g: with more, a wet road (friction 0.5) leaves nothing to steer"""
LEAST_BRAKE_N = 25.0
SLOW_MPS, SLOW_BRAKE_N = 9.0, 60.0
"""a slower car brakes with at least this force, 3 m/s^2: it stops within 14 m, also on a grade of
20 % downhill, on which the least force of a faster one does not stop it"""
HARD_BRAKE_N, HARD_BRAKE_RATE_N_PER_S = 100.0, 300.0
"""about 0.5 g, of a car whose place is not known: only a short stop keeps it near its path"""
LESS_BRAKE_N_PER_MPS2 = 20.0
"""on a wet road (friction 0.6) 100 N and a lateral acceleration of 3 m/s^2 exceed the grip"""
FULL_BRAKE_N, FULL_BRAKE_RATE_N_PER_S = (
    INPUT_LIMITS.upper.brake_n,
    INPUT_LIMITS.rate_per_s.brake_n,
)
"""of a car that cannot be steered: only the brake still acts"""
OPEN_THROTTLE_N = 120.0
"""brake force that balances a throttle that is fully open"""


def least_brake_n(vx_mps: float) -> float:
    """Least brake force of a stop at this speed, in N."""
    return SLOW_BRAKE_N if vx_mps < SLOW_MPS else LEAST_BRAKE_N


def brake_beside_n(
    lateral_mps2: float,
    wanted_mps2: float,
    open_throttle: float = 0.0,
    most_n: float = MOST_BRAKE_N,
    least_n: float = LEAST_BRAKE_N,
) -> float:
    """Brake force that leaves grip to a car that turns, in N.

    A car that turns otherwise than its wheel slides: it needs the grip of both.

    Args:
        lateral_mps2: lateral acceleration of the car, left positive.
        wanted_mps2: that of a steady turn with its wheel.
        open_throttle: by which the throttle is open against its command.
        most_n: of a straight car whose throttle is closed.
        least_n: see `least_brake_n`.
    """
    slide_mps2 = abs(wanted_mps2 - lateral_mps2)
    used_mps2 = max(abs(lateral_mps2), abs(wanted_mps2)) + slide_mps2
    beside_n = max(HARD_BRAKE_N - LESS_BRAKE_N_PER_MPS2 * used_mps2, least_n)
    driven_n = OPEN_THROTTLE_N * max(open_throttle, 0.0)
    return min(min(beside_n, most_n) + driven_n, FULL_BRAKE_N)
