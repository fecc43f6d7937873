"""`Monitor`: quantities of the car besides its motion, for logs, plots and rejecting episodes."""

from math import atan2
from typing import NamedTuple

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.axles import front_axle, rear_axle
from sim_bridge.plant.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT
from sim_bridge.plant.suspension import travel_m, tyre_load_n
from sim_bridge.plant.vehicle import Derivative, evaluate


class Monitor(NamedTuple):
    """The car at one instant; its `_fields` are the columns of a monitor array."""

    ax_mps2: float
    """acceleration of the centre of gravity, body axes"""
    ay_mps2: float
    sideslip_rad: float
    roll_rad: float
    pitch_rad: float
    gear: float
    engine_rpm: float
    throttle: float
    """opening, after the actuator lag"""
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
def monitor_of(state: Array, control: ControlInput, p: Parameters, scratch: Derivative) -> Monitor:
    """The monitor of a state under constant inputs.

    Below 0.5 m/s the sideslip is computed with 0.5 m/s: at rest it is not defined.
    """
    evaluate(state, control, p, scratch)
    front, rear = front_axle(p), rear_axle(p)
    vx_mps = state[AT.vx_mps]
    vy_mps = state[AT.vy_mps]
    yaw_rate = state[AT.yaw_rate_radps]
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
        travel_m(state, 0, front),
        travel_m(state, 1, front),
        travel_m(state, 2, rear),
        travel_m(state, 3, rear),
        tyre_load_n(state, 0, front, p.tyre),
        tyre_load_n(state, 1, front, p.tyre),
        tyre_load_n(state, 2, rear, p.tyre),
        tyre_load_n(state, 3, rear, p.tyre),
        state[AT.spin_radps],
        state[AT.spin_radps + 1],
        state[AT.spin_radps + 2],
        state[AT.spin_radps + 3],
    )
