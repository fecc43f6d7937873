"""`CommonRoadPlant`: CommonRoad's multi-body car as a plant, with a model of the actuators.

The model (Althoff, Wuersching: "CommonRoad: Vehicle Models", 2020) has 29 states and takes the
rate of the road wheels and an acceleration; it has no resistance to rolling. docs/plants.md lists
the actuators and resistances that are added here. Friction of the road scales the peaks of the
tyre's two Magic Formulas, not the stiffness.
"""

from math import nan, tan
from typing import Any

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import needs_extra
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.protocol import PlantOutputs, require_start_speed

STEERING_RATIO = 18.5
FULL_THROTTLE_MPS2 = 4.5
POWER_WPKG = 90.0
"""full-throttle power over mass: limits the drive above 20 m/s"""
BRAKE_MPS2_PER_N = 0.0527
"""7.9 m/s^2 with 150 N"""
ROLLING_MPS2 = 0.05
AIR_PER_M = 2.7e-4
"""air resistance over mass and speed squared"""
STEP_S = 0.001
ROLLED_OVER_RAD = 0.6
KINEMATIC_MPS = 0.1
"""below it the model is kinematic, and its lateral velocity state is not a motion of the car"""

STEER, VX, YAW_RATE, ROLL, PITCH, VY = 2, 3, 5, 6, 8, 10
"""positions in the state of the model; its vertical axis points down: roll and pitch are negated"""
_SPIN = slice(23, 27)
"""wheel speeds; the model does not allow negative ones"""
VEHICLES = ("1", "2", "3")
"""vehicles of CommonRoad with a multi-body model"""


class CommonRoadPlant:
    """The multi-body model of one of CommonRoad's vehicles; see `Plant` for the methods."""

    def __init__(self, vehicle: int, road_friction: float) -> None:
        """Raise a `MissingExtraError` if commonroad-vehicle-models is not installed."""
        with needs_extra("commonroad", "`plant` commonroad"):
            from vehiclemodels.init_mb import init_mb
            from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
            from vehiclemodels.vehicle_parameters import setup_vehicle_parameters
        self.name = f"commonroad:{vehicle}"
        self.failure: str | None = None
        self._initial_state, self._derivative = init_mb, vehicle_dynamics_mb
        self._parameters: Any = setup_vehicle_parameters(vehicle_id=vehicle)
        self._parameters.tire.p_dx1 *= road_friction
        self._parameters.tire.p_dy1 *= road_friction
        self._state = self._rates = np.empty(0)
        self._motion = np.empty((1, 3))
        self._steps = 0

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of a car in equilibrium.

        Raises:
            ConfigError: the speed is negative, too large or not a number.
        """
        require_start_speed(self.name, v0_mps)
        start = [0.0, 0.0, 0.0, v0_mps, 0.0, 0.0, 0.0]
        self._state = np.array(self._initial_state(start, self._parameters), dtype=float64)
        self._rates = np.zeros_like(self._state)
        self._steps = 0
        self.failure = None
        return np.array([v0_mps, 0.0, 0.0])

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion on a grid of `STEP_S`."""
        n_steps = max(round(dt_s / STEP_S), 1)
        step_s = dt_s / n_steps
        if n_steps != self._motion.shape[0]:
            self._motion = np.empty((n_steps, 3))
        for i in range(n_steps):
            if self.failure is None:
                self._advance(control, step_s)
            self._motion[i] = nan if self.failure else self._velocities()
        return self._motion

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step; the model has no engine and no hydraulics."""
        state, rates = self._state, self._rates
        return PlantOutputs(
            ax_mps2=float(rates[VX] - state[YAW_RATE] * state[VY]),
            ay_mps2=float(rates[VY] + state[YAW_RATE] * state[VX]),
            roll_rad=-float(state[ROLL]),
            pitch_rad=-float(state[PITCH]),
            road_wheel_rad=float(state[STEER]),
        )

    def close(self) -> None:
        """Do nothing: there are no resources."""

    def _advance(self, control: ControlInput, step_s: float) -> None:
        """One Runge-Kutta step of fourth order under constant actuators."""
        before = self._state
        turn_radps = (control.steer_rad / STEERING_RATIO - before[STEER]) / step_s
        inputs = (float(turn_radps), commanded_mps2(control, float(before[VX]), step_s))

        def rate(state: Array) -> Array:
            # The model writes into the list that it gets, and is faster with lists of floats.
            return np.array(self._derivative(state.tolist(), inputs, self._parameters))

        try:
            k1 = rate(before)
            k2 = rate(before + 0.5 * step_s * k1)
            k3 = rate(before + 0.5 * step_s * k2)
            k4 = rate(before + step_s * k3)
        except (ArithmeticError, ValueError) as error:
            self._fail(str(error))
            return
        self._rates = (k1 + 2.0 * (k2 + k3) + k4) / 6.0
        self._state = before + step_s * self._rates
        self._state[_SPIN] = np.maximum(self._state[_SPIN], 0.0)
        self._steps += 1
        if not np.isfinite(self._state).all():
            self._fail("the state is not finite")
        elif abs(self._state[ROLL]) > ROLLED_OVER_RAD:
            self._fail("the car has rolled over, which is outside the model")

    def _velocities(self) -> tuple[float, float, float]:
        state, p = self._state, self._parameters
        if abs(state[VX]) >= KINEMATIC_MPS:
            return state[VX], state[VY], state[YAW_RATE]
        yaw_rate_radps = state[VX] * tan(state[STEER]) / (p.a + p.b)
        return state[VX], yaw_rate_radps * p.b, yaw_rate_radps

    def _fail(self, reason: str) -> None:
        self.failure = f"{self.name}: at {self._steps * STEP_S:.3f} s: {reason}"


def commanded_mps2(control: ControlInput, vx_mps: float, step_s: float) -> float:
    """Acceleration from pedals and resistances, limited so that braking only stops the car."""
    drive_mps2 = control.throttle * min(FULL_THROTTLE_MPS2, POWER_WPKG / max(vx_mps, 1.0))
    resistance_mps2 = ROLLING_MPS2 + AIR_PER_M * vx_mps**2
    wanted_mps2 = drive_mps2 - BRAKE_MPS2_PER_N * control.brake_n - resistance_mps2
    return max(wanted_mps2, -max(vx_mps, 0.0) / step_s)
