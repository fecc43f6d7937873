"""What can be seen of the car beside its motion: for logs, plots and the rejection of episodes."""

from math import atan2
from typing import NamedTuple

from numpy import float64
from numpy.typing import NDArray

from sim_bridge.plant.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT
from sim_bridge.plant.suspension import travels_m
from sim_bridge.plant.vehicle import Derivative, evaluate


class Monitor(NamedTuple):
    """One instant of the car; its `_fields` are the columns of a monitor array."""

    ax_mps2: float
    """acceleration of the centre of gravity, body axes"""
    ay_mps2: float
    sideslip_rad: float
    roll_rad: float
    pitch_rad: float
    gear: float
    engine_rpm: float
    throttle: float
    """as opened, behind the actuator's lag"""
    brake_mpa: float
    """of the front circuit"""
    road_wheel_rad: float
    turbine_rpm: float
    wind_up_rad: float
    """twist of the drive shafts"""
    travel_front_left_m: float
    """of each wheel towards the body"""
    travel_front_right_m: float
    travel_rear_left_m: float
    travel_rear_right_m: float
    load_front_left_n: float
    load_front_right_n: float
    load_rear_left_n: float
    load_rear_right_n: float
    spin_front_left_radps: float
    spin_front_right_radps: float
    spin_rear_left_radps: float
    spin_rear_right_radps: float


N_MONITOR = len(Monitor._fields)

_LEAST_SPEED_MPS = 0.5


@compiled
def observe(
    state: NDArray[float64],
    throttle: float,
    brake_n: float,
    steer_rad: float,
    p: Parameters,
    scratch: Derivative,
) -> Monitor:
    """What an instant looks like under the inputs that hold in it; below walking pace the sideslip
    is measured against walking pace, since the direction of rest means nothing."""
    loads = evaluate(state, throttle, brake_n, steer_rad, p, scratch)
    vx_mps = state[AT.vx_mps]
    vy_mps = state[AT.vy_mps]
    yaw_rate = state[AT.yaw_rate_radps]
    travels = travels_m(state, p.body)
    return Monitor(
        scratch.rate[AT.vx_mps] - yaw_rate * vy_mps,
        scratch.rate[AT.vy_mps] + yaw_rate * vx_mps,
        atan2(vy_mps, max(vx_mps, _LEAST_SPEED_MPS)),
        state[AT.roll_rad],
        state[AT.pitch_rad],
        state[AT.gear],
        state[AT.engine_radps] * RPM_OF_RADPS,
        state[AT.throttle],
        state[AT.brake_mpa],
        state[AT.road_wheel_rad],
        state[AT.turbine_radps] * RPM_OF_RADPS,
        state[AT.wind_up_rad],
        travels.front_left,
        travels.front_right,
        travels.rear_left,
        travels.rear_right,
        loads.front_left,
        loads.front_right,
        loads.rear_left,
        loads.rear_right,
        state[AT.spin_radps],
        state[AT.spin_radps + 1],
        state[AT.spin_radps + 2],
        state[AT.spin_radps + 3],
    )
