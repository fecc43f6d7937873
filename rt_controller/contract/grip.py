"""Brake force that leaves the tyres grip to steer; the friction of the road is not known."""

MOST_BRAKE_N, BRAKE_RATE_N_PER_S = 100.0, 300.0
"""of a straight car, about 0.5 g"""
LEAST_BRAKE_N = 25.0
LESS_BRAKE_N_PER_MPS2 = 20.0
"""on a wet road (friction 0.6) 100 N and a lateral acceleration of 3 m/s^2 exceed the grip"""


def brake_beside_n(lateral_mps2: float) -> float:
    """Brake force beside a lateral acceleration, in N."""
    return max(MOST_BRAKE_N - LESS_BRAKE_N_PER_MPS2 * abs(lateral_mps2), LEAST_BRAKE_N)
