"""The further outputs of the own car, from its state."""

from math import atan2, sin

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant import body, steering
from sim_bridge.plant.axles import axles
from sim_bridge.plant.drive import powertrain
from sim_bridge.plant.drive.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT
from sim_bridge.plant.suspension import axle_roll_rad, travel_m, tyre_load_n
from sim_bridge.plant.vehicle import evaluate, front_wheels_rad
from sim_bridge.plant.wheels import new_derivative

N_OUTPUTS = len(PlantOutputs._fields)
_LEAST_SPEED_MPS = 0.5


@compiled
def write_outputs(state: Array, control: ControlInput, p: Parameters, row: Array) -> None:
    """Fill `row` (N_OUTPUTS,) with the fields of `PlantOutputs` under constant inputs.

    Below 0.5 m/s the sideslip is computed with 0.5 m/s: at rest it is not defined.
    """
    derivative = new_derivative()
    evaluate(state, control, p, derivative)
    front, rear = axles(p)
    vx_mps = state[AT.vx_mps]
    vy_mps = state[AT.vy_mps]
    yaw_rate = state[AT.yaw_rate_radps]
    ax_mps2 = derivative.rate[AT.vx_mps] - yaw_rate * vy_mps
    ay_mps2 = derivative.rate[AT.vy_mps] + yaw_rate * vx_mps
    gravity = body.gravity_in_road_axes(p.road)
    # The sprung mass moves against the centre of gravity of the whole car as it rolls and pitches.
    unsprung_share = 1.0 - p.body.sprung_mass_kg / p.body.mass_kg
    left_arm_m = unsprung_share * body.roll_arm_m(p.body, p.suspension)
    forward_arm_m = unsprung_share * body.pitch_arm_m(p.body, p.suspension)
    roll_radps2 = derivative.rate[AT.roll_rate_radps]
    pitch_radps2 = derivative.rate[AT.pitch_rate_radps]
    left_rad, right_rad = front_wheels_rad(state, axle_roll_rad(state, 0, front), front, p)
    outputs = PlantOutputs(
        ax_mps2,
        ay_mps2,
        atan2(vy_mps, max(vx_mps, _LEAST_SPEED_MPS)),
        state[AT.roll_rad],
        state[AT.pitch_rad],
        state[AT.gear],
        state[AT.engine_radps] * RPM_OF_RADPS,
        state[AT.throttle],
        state[AT.brake_mpa],
        0.5 * (left_rad + right_rad),
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
        ax_mps2 - gravity.forward_mps2 + forward_arm_m * pitch_radps2
        - GRAVITY_MPS2 * sin(state[AT.pitch_rad]),
        ay_mps2 - gravity.left_mps2 - left_arm_m * roll_radps2
        + GRAVITY_MPS2 * sin(state[AT.roll_rad]),
        steering.hand_torque_nm(control.steer_rad, state[AT.road_wheel_rad], p.steering),
        powertrain.drive_nm(state, p),
    )  # fmt: skip
    for i in range(N_OUTPUTS):
        row[i] = outputs[i]
