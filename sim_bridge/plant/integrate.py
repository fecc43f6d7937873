"""Time: fixed steps of the car, by the period and by the episode.

Midpoint rule; lags are solved exactly over each half and whole step (exponential midpoint), dry
friction by projection, gears change between steps. Nothing here knows roads or curvature.
"""

from math import exp, isfinite

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.brakes import after_friction, front_pressure_mpa, rear_pressure_mpa
from sim_bridge.plant.engine import RPM_OF_RADPS
from sim_bridge.plant.gearbox import choose_gear, highest_gear
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.monitor import N_MONITOR, observe
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.powertrain import output_speed_radps
from sim_bridge.plant.states import AT, N_FRONT, N_STATES, N_WHEELS
from sim_bridge.plant.vehicle import Derivative, bound, evaluate

STEP_S = 0.001
STEPS_PER_PERIOD = 25
"""of STEP_S in a control period"""


@compiled
def advance(
    state: NDArray[float64],
    throttle: float,
    brake_n: float,
    steer_rad: float,
    parameters: Parameters,
    n_steps: int,
    step_s: float,
    motion_out: NDArray[float64],
) -> None:
    """Move `state` on by `n_steps` under held inputs, in place.

    Args:
        motion_out: (n_steps, 3), filled with (vx_mps, vy_mps, yaw_rate_radps) of the centre of
            gravity after each step.
    """
    _advance(
        state,
        throttle,
        brake_n,
        steer_rad,
        parameters,
        n_steps,
        step_s,
        motion_out,
        np.empty(N_STATES),
        _empty_derivative(),
    )


@compiled
def simulate(
    state0: NDArray[float64],
    inputs: NDArray[float64],
    parameters: Parameters,
    steps_per_period: int,
    step_s: float,
) -> tuple[NDArray[float64], NDArray[float64]]:
    """Motion and monitor of a whole episode; `state0` is left as it is.

    Args:
        inputs: (K, 3), columns as `ControlInput`, each row held for a period.

    Returns:
        motion: (K * steps_per_period + 1, 3), (vx_mps, vy_mps, yaw_rate_radps) on the fine grid.
        monitor: (K + 1, N_MONITOR), at the periods' ends, columns as `Monitor._fields`.
    """
    n_periods = inputs.shape[0]
    state = state0.copy()
    middle = np.empty(N_STATES)
    derivative = _empty_derivative()
    motion = np.empty((n_periods * steps_per_period + 1, 3))
    monitor = np.empty((n_periods + 1, N_MONITOR))
    _write_motion(state, motion[0])
    for k in range(n_periods):
        throttle, brake_n, steer_rad = inputs[k, 0], inputs[k, 1], inputs[k, 2]
        if k == 0:
            _log(state, throttle, brake_n, steer_rad, parameters, derivative, monitor[0])
        first = k * steps_per_period + 1
        _advance(
            state,
            throttle,
            brake_n,
            steer_rad,
            parameters,
            steps_per_period,
            step_s,
            motion[first : first + steps_per_period],
            middle,
            derivative,
        )
        _log(state, throttle, brake_n, steer_rad, parameters, derivative, monitor[k + 1])
    return motion, monitor


@compiled
def glance(
    state: NDArray[float64],
    throttle: float,
    brake_n: float,
    steer_rad: float,
    parameters: Parameters,
    monitor_out: NDArray[float64],
) -> None:
    """Fill `monitor_out` (N_MONITOR,) with what `state` looks like under the given inputs."""
    _log(state, throttle, brake_n, steer_rad, parameters, _empty_derivative(), monitor_out)


@compiled
def _empty_derivative() -> Derivative:
    return Derivative(np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES))


@compiled
def _write_motion(state: NDArray[float64], row: NDArray[float64]) -> None:
    row[0] = state[AT.vx_mps]
    row[1] = state[AT.vy_mps]
    row[2] = state[AT.yaw_rate_radps]


@compiled
def _log(
    state: NDArray[float64],
    throttle: float,
    brake_n: float,
    steer_rad: float,
    p: Parameters,
    derivative: Derivative,
    row: NDArray[float64],
) -> None:
    seen = observe(state, throttle, brake_n, steer_rad, p, derivative)
    for i in range(N_MONITOR):
        row[i] = seen[i]


@compiled
def _advance(
    state: NDArray[float64],
    throttle: float,
    brake_n: float,
    steer_rad: float,
    p: Parameters,
    n_steps: int,
    step_s: float,
    motion_out: NDArray[float64],
    middle: NDArray[float64],
    derivative: Derivative,
) -> None:
    for i in range(n_steps):
        choose_gear(state, output_speed_radps(state, p), p.gearbox, step_s)
        evaluate(state, throttle, brake_n, steer_rad, p, derivative)
        _move(state, derivative, 0.5 * step_s, middle)
        evaluate(middle, throttle, brake_n, steer_rad, p, derivative)
        _move(state, derivative, step_s, state)
        _write_motion(state, motion_out[i])


@compiled
def _move(
    state: NDArray[float64], derivative: Derivative, step_s: float, out: NDArray[float64]
) -> None:
    """Write to `out` where `state` goes under constant rate, decay and dry friction."""
    for i in range(N_STATES):
        turns = derivative.decay[i] * step_s
        if turns > 1e-9:
            left = exp(-turns)
            out[i] = state[i] * left + derivative.rate[i] * step_s * (1.0 - left) / turns
        else:
            out[i] = state[i] + derivative.rate[i] * step_s
    for i in range(AT.spin_radps, AT.spin_radps + N_WHEELS):
        out[i] = after_friction(out[i], derivative.friction[i] * step_s)
    i = AT.road_wheel_rate_radps
    out[i] = after_friction(out[i], derivative.friction[i] * step_s)
    bound(out)


_SETTLING_S = 2.0
_FIRST_THROTTLE = 0.12
_THROTTLE_PER_MPS = 1.2
_HOLDING_BRAKE_N = 60.0


def settle(v0_mps: float, parameters: Parameters) -> NDArray[float64]:
    """A state that drives straight ahead at `v0_mps` with everything behind it settled.

    Gear, engine, converter, slips, pitch and the throttle that holds the speed have come to rest
    in a run on which the speed is held from outside. A car that stands (`v0_mps` = 0) stands on
    its brake, since the converter would make it creep.

    Raises:
        ConfigError: the speed is negative or not a number.
    """
    if not (isfinite(v0_mps) and v0_mps >= 0.0):
        raise ConfigError(
            f"initial speed: expected a number of m/s that is not negative, found {v0_mps}. "
            f"The car starts standing or driving forward."
        )
    state = np.zeros(N_STATES)
    state[AT.vx_mps] = v0_mps
    state[AT.throttle] = _FIRST_THROTTLE if v0_mps > 0.0 else 0.0
    brake_n = 0.0 if v0_mps > 0.0 else _HOLDING_BRAKE_N
    _settle(state, v0_mps, brake_n, parameters, round(_SETTLING_S / STEP_S), STEP_S)
    return state


@compiled
def _settle(
    state: NDArray[float64],
    v0_mps: float,
    brake_n: float,
    p: Parameters,
    n_steps: int,
    step_s: float,
) -> None:
    front_mpa = front_pressure_mpa(brake_n, p.brakes)
    rear_mpa = rear_pressure_mpa(front_mpa, p.brakes)
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
    state[AT.engine_radps] = max(p.engine.idle_speed_rpm / RPM_OF_RADPS, 1.03 * turbine)
    motion = np.empty((1, 3))
    middle = np.empty(N_STATES)
    derivative = _empty_derivative()
    throttle = state[AT.throttle]
    for _ in range(n_steps):
        _advance(state, throttle, brake_n, 0.0, p, 1, step_s, motion, middle, derivative)
        if v0_mps > 0.0:
            slower_mps = v0_mps - state[AT.vx_mps]
            throttle = min(1.0, max(0.0, throttle + _THROTTLE_PER_MPS * slower_mps))
            state[AT.vx_mps] = v0_mps
    for wheel in range(N_WHEELS):
        state[AT.lateral_slip + wheel] = 0.0
    state[AT.vy_mps] = 0.0
    state[AT.yaw_rate_radps] = 0.0
