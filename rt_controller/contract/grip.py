"""Brake force that leaves the tyres grip to steer; the friction of the road is not known."""

LEAST_BRAKE_N = 25.0
LESS_BRAKE_N_PER_MPS2 = 20.0
"""on a wet road (friction 0.6) 100 N and a lateral acceleration of 3 m/s^2 exceed the grip"""


def brake_beside_n(most_n: float, lateral_mps2: float) -> float:
    """Brake force beside a lateral acceleration, in N; `most_n` is that of a straight car."""
    return max(most_n - LESS_BRAKE_N_PER_MPS2 * abs(lateral_mps2), LEAST_BRAKE_N)
