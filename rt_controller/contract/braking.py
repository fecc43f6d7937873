"""How hard a stopping car brakes beside its cornering: one law of controller and vehicle."""

from math import inf

from rt_controller.contract.limits import INPUT_LIMITS, SteeringGeometry
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S

MOST_BRAKE_N, BRAKE_RATE_N_PER_S = 75.0, 150.0
"""of a straight car, about 0.4 g: with more, a wet road (friction 0.5) leaves nothing to steer"""
LEAST_BRAKE_N = 25.0
SLOW_MPS, SLOW_BRAKE_N = 9.0, 60.0
"""a slower car brakes with at least this force, 3 m/s^2: it stops within 14 m on a level road, and
also 20 % downhill, where the least force of a faster one does not stop it"""
LEAST_SLOWING_MPS2, TOLERATED_MPS, MORE_BRAKE_N_PER_MPS = 0.8, 0.3, 20.0
"""deceleration that a stop has at least where the grip allows it; excess of the speed over it that
is tolerated; force that is added for each m/s of further excess"""
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


def stop_speed_mps(before_mps: float, vx_mps: float, periods: int = 1) -> float:
    """Largest speed of a stopping car, from that of the tick before; infinite: it begins now."""
    return min(before_mps, vx_mps) - LEAST_SLOWING_MPS2 * PERIOD_S * periods


def least_brake_n(vx_mps: float, stop_mps: float = inf) -> float:
    """Least brake force of a stop, in N: more downhill, where a car gains speed beside a bend.

    Args:
        vx_mps: speed of the car.
        stop_mps: see `stop_speed_mps`.
    """
    if vx_mps < SLOW_MPS:
        return SLOW_BRAKE_N
    more_n = MORE_BRAKE_N_PER_MPS * max(vx_mps - stop_mps - TOLERATED_MPS, 0.0)
    return min(LEAST_BRAKE_N + more_n, SLOW_BRAKE_N)


def brake_beside_n(
    state: VehicleState,
    steer_rad: float,
    geometry: SteeringGeometry,
    stop_mps: float = inf,
    open_throttle: float = 0.0,
    most_n: float = MOST_BRAKE_N,
) -> float:
    """Brake force that leaves grip to a car that turns, in N.

    A car that turns otherwise than its wheel slides: it needs the grip of both.

    Args:
        state: of the car.
        steer_rad: angle of the steering wheel.
        geometry: of the car.
        stop_mps: see `stop_speed_mps`.
        open_throttle: by which the throttle is open against its command.
        most_n: of a straight car whose throttle is closed.
    """
    lateral_mps2 = state.vx_mps * state.yaw_rate_radps
    wanted_mps2 = geometry.steady_lateral_mps2(state.vx_mps, steer_rad)
    slide_mps2 = abs(wanted_mps2 - lateral_mps2)
    used_mps2 = max(abs(lateral_mps2), abs(wanted_mps2)) + slide_mps2
    least_n = least_brake_n(state.vx_mps, stop_mps)
    beside_n = max(HARD_BRAKE_N - LESS_BRAKE_N_PER_MPS2 * used_mps2, least_n)
    driven_n = OPEN_THROTTLE_N * open_throttle if open_throttle > 0.0 else 0.0
    return min(min(beside_n, most_n) + driven_n, FULL_BRAKE_N)
