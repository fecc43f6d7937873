"""Time integration of the car with a fixed step: by the period, by the episode, and settling.

Midpoint rule; first-order lags are solved exactly over each half and whole step (exponential
midpoint), dry friction by projection; gears change between steps. The road is not part of this
module.
"""

from math import ceil, exp
from typing import Any

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.brakes import after_friction, steady_pressures_mpa
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.drive.engine import RPM_OF_RADPS
from sim_bridge.plant.drive.gearbox import choose_gear, highest_gear
from sim_bridge.plant.drive.powertrain import output_speed_radps
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.outputs import N_OUTPUTS, write_outputs
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import require_start_speed
from sim_bridge.plant.states import AT, N_FRONT, N_STATES, N_WHEELS
from sim_bridge.plant.vehicle import bound, evaluate
from sim_bridge.plant.wheels import LARGEST_STEP_S, Derivative, new_derivative

STEPS_PER_PERIOD = ceil(PERIOD_S / LARGEST_STEP_S - 1e-9)
"""integration steps in a control period"""
STEP_S = PERIOD_S / STEPS_PER_PERIOD


@compiled
def advance(
    state: Array,
    control: ControlInput,
    p: Parameters,
    n_steps: int,
    step_s: float,
    motion_out: Array,
) -> None:
    """Integrate `state` over `n_steps` under constant inputs, in place.

    Args:
        motion_out: (n_steps, 3), filled with (vx_mps, vy_mps, yaw_rate_radps) of the centre of
            gravity after each step.
    """
    middle = np.empty(N_STATES)
    derivative = new_derivative()
    for i in range(n_steps):
        choose_gear(state, output_speed_radps(state, p), p.gearbox, step_s)
        evaluate(state, control, p, derivative)
        _step(state, derivative, p, 0.5 * step_s, middle)
        evaluate(middle, control, p, derivative)
        _step(state, derivative, p, step_s, state)
        _write_motion(state, motion_out[i])


def simulate(
    state0: Array,
    inputs: Array,
    p: Parameters,
    steps_per_period: int,
    step_s: float,
    roads: Array | None = None,
) -> tuple[Array, Array]:
    """Motion and outputs of a whole episode; `state0` is not changed.

    Args:
        inputs: (K, 3), columns as `ControlInput`, each row constant over a period.
        roads: (K, 6), columns as `RoadParameters`, likewise; None: the road of `p` throughout.

    Returns:
        motion: (K * steps_per_period + 1, 3), (vx_mps, vy_mps, yaw_rate_radps) on the fine grid.
        outputs: (K + 1, N_OUTPUTS), at the periods' ends, columns as `PlantOutputs._fields`.
    """
    if roads is None:
        roads = np.tile(np.array(p.road), (len(inputs), 1))
    return _simulate(state0, inputs, roads, car_record(p), steps_per_period, step_s)


@compiled
def _simulate(
    state0: Array,
    inputs: Array,
    roads: Array,
    p: Parameters,
    steps_per_period: int,
    step_s: float,
) -> tuple[Array, Array]:
    n_periods = inputs.shape[0]
    state = state0.copy()
    motion = np.empty((n_periods * steps_per_period + 1, 3))
    outputs = np.empty((n_periods + 1, N_OUTPUTS))
    _write_motion(state, motion[0])
    for k in range(n_periods):
        control = ControlInput(inputs[k, 0], inputs[k, 1], inputs[k, 2])
        _set_road(p, roads[k])
        if k == 0:
            write_outputs(state, control, p, outputs[0])
        first = k * steps_per_period + 1
        piece = motion[first : first + steps_per_period]
        advance(state, control, p, steps_per_period, step_s, piece)
        write_outputs(state, control, p, outputs[k + 1])
    return motion, outputs


@compiled
def _set_road(p: Any, row: Array) -> None:
    """Write a row with the columns of `RoadParameters` into the record of a car."""
    p.road.friction_left = row[0]
    p.road.friction_right = row[1]
    p.road.bank_rad = row[2]
    p.road.grade_rad = row[3]
    p.road.wind_forward_mps = row[4]
    p.road.wind_left_mps = row[5]


@compiled
def _write_motion(state: Array, row: Array) -> None:
    row[0] = state[AT.vx_mps]
    row[1] = state[AT.vy_mps]
    row[2] = state[AT.yaw_rate_radps]


@compiled
def _step(state: Array, derivative: Derivative, p: Parameters, step_s: float, out: Array) -> None:
    """Write `state` after `step_s` under constant rate, decay and dry friction to `out`."""
    for i in range(N_STATES):
        exponent = derivative.decay[i] * step_s
        if exponent > 1e-9:
            left = exp(-exponent)
            out[i] = state[i] * left + derivative.rate[i] * step_s * (1.0 - left) / exponent
        else:
            out[i] = state[i] + derivative.rate[i] * step_s
    for i in range(AT.spin_radps, AT.spin_radps + N_WHEELS):
        out[i] = after_friction(out[i], derivative.friction[i] * step_s)
    i = AT.road_wheel_rate_radps
    out[i] = after_friction(out[i], derivative.friction[i] * step_s)
    bound(out, p)


_SETTLING_STEPS = round(2.0 / STEP_S)
_STANDING_STEPS = round(6.0 / STEP_S)
"""at rest longer, until the pitch by the torque of the idling engine has settled"""
_FIRST_THROTTLE = 0.12
_THROTTLE_PER_MPS = 1.2
_HOLDING_BRAKE_N = 60.0


def settle(v0_mps: float, p: Parameters) -> Array:
    """The state of a car that drives straight ahead at `v0_mps`, all other states settled.

    Gear, engine, converter, slips, pitch and the throttle that keeps the speed result from 2 s of
    simulation in which the speed is kept constant. With `v0_mps` = 0 the brake is applied, because
    the converter would move the car, and the simulation lasts 6 s.

    Raises:
        ConfigError: the speed is negative, too large or not a number.
    """
    require_start_speed("own car", v0_mps)
    return _settle(v0_mps, car_record(p))


@compiled
def _settle(v0_mps: float, p: Parameters) -> Array:
    state = np.zeros(N_STATES)
    state[AT.vx_mps] = v0_mps
    state[AT.throttle] = _FIRST_THROTTLE if v0_mps > 0.0 else 0.0
    brake_n = 0.0 if v0_mps > 0.0 else _HOLDING_BRAKE_N
    front_mpa, rear_mpa = steady_pressures_mpa(brake_n, p.brakes)
    for wheel in range(N_WHEELS):
        state[AT.spin_radps + wheel] = v0_mps / p.tyre.rolling_radius_m
        state[AT.brake_mpa + wheel] = front_mpa if wheel < N_FRONT else rear_mpa
    output = output_speed_radps(state, p)
    gear = highest_gear(output, state[AT.throttle], p.gearbox)
    state[AT.gear] = gear
    state[AT.gear_before] = gear
    state[AT.since_shift_s] = p.gearbox.dwell_s
    turbine = output * p.gearbox.ratios[int(gear) - 1]
    state[AT.turbine_radps] = turbine
    state[AT.engine_radps] = turbine
    if p.motor.inertia_kgm2 == 0.0:
        state[AT.engine_radps] = max(p.engine.idle_speed_rpm / RPM_OF_RADPS, 1.03 * turbine)
    motion = np.empty((1, 3))
    throttle = state[AT.throttle]
    for _ in range(_SETTLING_STEPS if v0_mps > 0.0 else _STANDING_STEPS):
        # A literal number of steps would be compiled as a type of its own.
        advance(state, ControlInput(throttle, brake_n, 0.0), p, len(motion), STEP_S, motion)
        if v0_mps > 0.0:
            slower_mps = v0_mps - state[AT.vx_mps]
            throttle = min(1.0, max(0.0, throttle + _THROTTLE_PER_MPS * slower_mps))
            state[AT.vx_mps] = v0_mps
            state[AT.throttle] = throttle  # without the lag of the actuator
    if v0_mps > 0.0:
        # A bank or a cross-wind has pushed the car aside; at rest its tyres carry that force.
        for wheel in range(N_WHEELS):
            state[AT.lateral_slip + wheel] = 0.0
        state[AT.vy_mps] = 0.0
        state[AT.yaw_rate_radps] = 0.0
    return state
