"""Kinematics of a car in the frame of its road, over one period: relations between the states.

They hold for every car on every ground: sliding, wind and bank do not change them.
"""

from math import cos, hypot, sin
from typing import NamedTuple

from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S

STEERING_DELAY_S = 0.2
"""until the steering acts"""
RETURN_MPS2 = 4.0
"""lateral acceleration with which a car is led back to its path"""
SLIDING_MPS = 1.0
"""lateral speed of a car that slides; that of a standing car may have an offset"""
_LEAST_GAP = 0.05
"""lower limit of 1 - curvature * e_y, as in the frame of the simulated road"""


class Pose(NamedTuple):
    """Place of the car on its road."""

    ey_m: float
    epsi_rad: float


def speed_of(state: VehicleState) -> float:
    """Speed in m/s: v_x, and v_y too of a car that slides sideways and is therefore not at rest."""
    is_sliding = abs(state.vy_mps) > SLIDING_MPS
    return hypot(state.vx_mps, state.vy_mps) if is_sliding else state.vx_mps


def progress_m(before: VehicleState, now: VehicleState, curvature_per_m: float) -> float:
    """Progress along the road in the period between two states, from everything but Δs."""
    vx_mps = 0.5 * (before.vx_mps + now.vx_mps)
    vy_mps = 0.5 * (before.vy_mps + now.vy_mps)
    along_mps = vx_mps * cos(now.epsi_rad) - vy_mps * sin(now.epsi_rad)
    return PERIOD_S * along_mps / max(_LEAST_GAP, 1.0 - curvature_per_m * now.ey_m)


def heading_change_rad(
    before: VehicleState, now: VehicleState, mean_curvature_per_m: float, moved_m: float
) -> float:
    """Change of e_psi in that period, from the yaw rates and the turn of the road."""
    yaw_rate = 0.5 * (before.yaw_rate_radps + now.yaw_rate_radps)
    return PERIOD_S * yaw_rate - mean_curvature_per_m * moved_m


def lateral_change_m(before: VehicleState, now: VehicleState) -> float:
    """Change of e_y in that period, from the velocities and the headings."""
    return lateral_change_along_m(before, now, 0.5 * (before.epsi_rad + now.epsi_rad))


def lateral_change_along_m(before: VehicleState, now: VehicleState, epsi_rad: float) -> float:
    """The same with another mean heading than that of the two states."""
    vx_mps = 0.5 * (before.vx_mps + now.vx_mps)
    vy_mps = 0.5 * (before.vy_mps + now.vy_mps)
    return PERIOD_S * (vx_mps * sin(epsi_rad) + vy_mps * cos(epsi_rad))


def farthest_m(off_path_m: float, away_mps: float) -> float:
    """Largest distance from the path of a car that is led back to it from now on, in m.

    Args:
        off_path_m: lateral distance now, left positive.
        away_mps: its rate.
    """
    reach_m = away_mps * STEERING_DELAY_S + abs(away_mps) * away_mps / (2.0 * RETURN_MPS2)
    return max(abs(off_path_m), abs(off_path_m + reach_m))
