"""How a car turns: what its tyres already give to the path."""

from typing import NamedTuple

from rt_controller.contract.grip import LEAST_BRAKE_N, SLOW_MPS, least_brake_n
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.steering_geometry import SteeringGeometry


class Cornering(NamedTuple):
    """The turn of a car in one tick."""

    counter_steering_rad: float = 0.0
    """steering-wheel angle minus that of a steady turn with this yaw rate"""
    lateral_mps2: float = 0.0
    """speed times yaw rate"""
    wanted_mps2: float = 0.0
    """lateral acceleration of a steady turn with this wheel"""
    least_brake_n: float = LEAST_BRAKE_N
    """of a stop at this speed"""


def cornering_of(
    state: VehicleState | None, steer_rad: float, geometry: SteeringGeometry
) -> Cornering:
    """The turn of a car in `state`, with the steering wheel at `steer_rad`."""
    if state is None:
        return Cornering()
    lateral_mps2 = state.vx_mps * state.yaw_rate_radps
    wanted_mps2 = geometry.steady_lateral_mps2(state.vx_mps, steer_rad)
    least_n = least_brake_n(state.vx_mps)
    if state.vx_mps < SLOW_MPS:  # its stop is short, and its yaw rate says little about the wheel
        return Cornering(0.0, lateral_mps2, wanted_mps2, least_n)
    steady_rad = geometry.steady_wheel_rad(state.vx_mps, state.yaw_rate_radps)
    return Cornering(steer_rad - steady_rad, lateral_mps2, wanted_mps2, least_n)
