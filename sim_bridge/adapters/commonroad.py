"""CommonRoad's multi-body car as a plant, behind a thin layer of actuators.

The model (Althoff, Wuersching: "CommonRoad: Vehicle Models", 2020) has 29 states and takes the
rate of the road wheels and an acceleration. The layer between it and the contract:

- the steering wheel turns the road wheels by a fixed ratio, at most at the model's own rate;
- the accelerator asks for a share of what the engine can give: a constant force up to a speed,
  constant power above it;
- the brake pedal asks for a deceleration in proportion to its force; it stops a car and does not
  drive it backwards;
- the model rolls without resistance, so rolling and air resistance are added to what is asked.

Friction of the road scales the peaks of the tyre's two Magic Formulas and leaves stiffness alone.
"""

from math import isfinite, nan, tan
from typing import Any

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.protocol import PlantOutputs

STEERING_RATIO = 18.5
FULL_THROTTLE_MPS2 = 4.5
POWER_WPKG = 90.0
"""full-throttle power over mass: takes over from the constant force at 20 m/s"""
BRAKE_MPS2_PER_N = 0.0527
"""150 N ask for 7.9 m/s^2"""
ROLLING_MPS2 = 0.05
AIR_PER_M = 2.7e-4
"""air resistance over mass and speed squared"""
STEP_S = 0.001
ROLLED_OVER_RAD = 0.6
KINEMATIC_MPS = 0.1
"""below it the model rolls where its wheels point, and what it keeps as lateral speed rings on"""

_STEER, _VX, _YAW_RATE, _ROLL, _PITCH, _VY = 2, 3, 5, 6, 8, 10
_SPIN = slice(23, 27)
"""the model's wheels never turn backwards"""
_VEHICLES = (1, 2, 3)


class CommonRoadPlant:
    """The multi-body model of one of CommonRoad's vehicles; see `Plant` for the promises."""

    def __init__(self, vehicle: int, road_friction: float) -> None:
        try:
            from vehiclemodels.init_mb import init_mb
            from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
            from vehiclemodels.vehicle_parameters import setup_vehicle_parameters
        except ModuleNotFoundError as error:
            raise MissingExtraError(
                f"--plant commonroad needs {error.name}: expected the extra [commonroad], found "
                f'it missing. Install it with: pip install -e ".[commonroad]"'
            ) from error
        if vehicle not in _VEHICLES:
            raise ConfigError(
                f"--plant commonroad:{vehicle}: expected a vehicle with a multi-body model, "
                f"{', '.join(str(known) for known in _VEHICLES)}, found {vehicle}."
            )
        self.name = f"commonroad:{vehicle}"
        self.failure: str | None = None
        self._parameters: Any = setup_vehicle_parameters(vehicle_id=vehicle)
        self._parameters.tire.p_dx1 *= road_friction
        self._parameters.tire.p_dy1 *= road_friction
        self._initial_state = init_mb
        self._derivative = vehicle_dynamics_mb
        self._state = np.empty(0)
        self._rates = np.empty(0)
        self._motion = np.empty((1, 3))
        self._steps = 0

    def reset(self, v0_mps: float) -> NDArray[float64]:
        """(vx_mps, vy_mps, yaw_rate_radps) of a car in equilibrium.

        Raises:
            ConfigError: the speed is negative or not a number.
        """
        if not (isfinite(v0_mps) and v0_mps >= 0.0):
            raise ConfigError(
                f"{self.name}: expected a first speed that is not negative, found {v0_mps} m/s. "
                f"The car starts standing or driving forward."
            )
        start = [0.0, 0.0, 0.0, v0_mps, 0.0, 0.0, 0.0]
        self._state = np.array(self._initial_state(start, self._parameters), dtype=float64)
        self._rates = np.zeros_like(self._state)
        self._steps = 0
        self.failure = None
        return np.array([v0_mps, 0.0, 0.0])

    def step(self, control: ControlInput, dt_s: float) -> NDArray[float64]:
        """(n, 3) motion on a grid of `STEP_S`."""
        n_steps = max(round(dt_s / STEP_S), 1)
        step_s = dt_s / n_steps
        if n_steps != self._motion.shape[0]:
            self._motion = np.empty((n_steps, 3))
        for i in range(n_steps):
            if self.failure is None:
                self._advance(control, step_s)
            if self.failure is None:
                self._write_motion(self._motion[i])
            else:
                self._motion[i] = nan
        return self._motion

    def outputs(self) -> PlantOutputs:
        """What the last step ended with; the model has no engine and no hydraulics."""
        state, rates = self._state, self._rates
        return PlantOutputs(
            ax_mps2=float(rates[_VX] - state[_YAW_RATE] * state[_VY]),
            ay_mps2=float(rates[_VY] + state[_YAW_RATE] * state[_VX]),
            # The model's vertical axis points down.
            roll_rad=-float(state[_ROLL]),
            pitch_rad=-float(state[_PITCH]),
            road_wheel_rad=float(state[_STEER]),
        )

    def close(self) -> None:
        """Nothing is held."""

    def _advance(self, control: ControlInput, step_s: float) -> None:
        """One Runge-Kutta step of fourth order under held actuators."""
        before = self._state
        turn_radps = (control.steer_rad / STEERING_RATIO - before[_STEER]) / step_s
        actuators = [turn_radps, asked_acceleration_mps2(control, float(before[_VX]), step_s)]
        try:
            k1 = self._rate(before, actuators)
            k2 = self._rate(before + 0.5 * step_s * k1, actuators)
            k3 = self._rate(before + 0.5 * step_s * k2, actuators)
            k4 = self._rate(before + step_s * k3, actuators)
        except (ArithmeticError, ValueError) as error:
            self._fail(str(error))
            return
        self._rates = (k1 + 2.0 * (k2 + k3) + k4) / 6.0
        self._state = before + step_s * self._rates
        self._state[_SPIN] = np.maximum(self._state[_SPIN], 0.0)
        self._steps += 1
        if not np.isfinite(self._state).all():
            self._fail("the state is no longer made of numbers")
        elif abs(self._state[_ROLL]) > ROLLED_OVER_RAD:
            self._fail("the car has rolled over, which the model does not describe")

    def _write_motion(self, row: NDArray[float64]) -> None:
        state = self._state
        vx_mps = state[_VX]
        if abs(vx_mps) >= KINEMATIC_MPS:
            row[:] = vx_mps, state[_VY], state[_YAW_RATE]
            return
        p = self._parameters
        yaw_rate_radps = vx_mps * tan(state[_STEER]) / (p.a + p.b)
        row[:] = vx_mps, yaw_rate_radps * p.b, yaw_rate_radps

    def _rate(self, state: NDArray[float64], actuators: list[float]) -> NDArray[float64]:
        # The model clips the list that it is given, so each call gets its own; a list of plain
        # floats is also much faster there than an array.
        return np.array(self._derivative(state.tolist(), actuators, self._parameters))

    def _fail(self, why: str) -> None:
        self.failure = f"{self.name}: at {self._steps * STEP_S:.3f} s: {why}"


def asked_acceleration_mps2(control: ControlInput, vx_mps: float, step_s: float) -> float:
    """What pedals and resistances ask of the model; never more braking than stops the car."""
    drive_mps2 = control.throttle * min(FULL_THROTTLE_MPS2, POWER_WPKG / max(vx_mps, 1.0))
    resistance_mps2 = ROLLING_MPS2 + AIR_PER_M * vx_mps**2
    asked_mps2 = drive_mps2 - BRAKE_MPS2_PER_N * control.brake_n - resistance_mps2
    return max(asked_mps2, -max(vx_mps, 0.0) / step_s)
