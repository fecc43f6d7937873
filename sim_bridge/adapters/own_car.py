"""The project's own car as a plant: its state vector, stepped by the compiled kernels."""

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, advance, glance, settle
from sim_bridge.plant.monitor import N_MONITOR, Monitor
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT


class OwnCar:
    """The nonlinear car of `sim_bridge.plant`; see `Plant` for what its methods promise."""

    def __init__(self, parameters: Parameters, name: str = "own car") -> None:
        self.name = name
        self.failure: str | None = None
        self.parameters = parameters
        self._state = np.empty(0)
        self._motion = np.empty((STEPS_PER_PERIOD, 3))
        self._seen = np.empty(N_MONITOR)
        self._input = NEUTRAL_INPUT

    def reset(self, v0_mps: float) -> NDArray[float64]:
        """(vx_mps, vy_mps, yaw_rate_radps) of the settled car."""
        self._state = settle(v0_mps, self.parameters)
        self._input = NEUTRAL_INPUT
        return self._state[[AT.vx_mps, AT.vy_mps, AT.yaw_rate_radps]]

    def step(self, control: ControlInput, dt_s: float) -> NDArray[float64]:
        """(n, 3) motion on the grid of `STEP_S`.

        Raises:
            ConfigError: `dt_s` is no whole number of steps.
        """
        n_steps = round(dt_s / STEP_S)
        if n_steps != self._motion.shape[0]:
            self._motion = np.empty((_whole_steps(dt_s), 3))
        self._input = control
        advance(
            self._state,
            control.throttle,
            control.brake_n,
            control.steer_rad,
            self.parameters,
            n_steps,
            STEP_S,
            self._motion,
        )
        return self._motion

    def outputs(self) -> PlantOutputs:
        """What the last step ended with."""
        seen = self.monitor
        return PlantOutputs(
            ax_mps2=seen.ax_mps2,
            ay_mps2=seen.ay_mps2,
            roll_rad=seen.roll_rad,
            pitch_rad=seen.pitch_rad,
            road_wheel_rad=seen.road_wheel_rad,
            throttle=seen.throttle,
            brake_mpa=seen.brake_mpa,
            gear=seen.gear,
            engine_rpm=seen.engine_rpm,
            load_front_left_n=seen.load_front_left_n,
            load_front_right_n=seen.load_front_right_n,
            load_rear_left_n=seen.load_rear_left_n,
            load_rear_right_n=seen.load_rear_right_n,
        )

    def close(self) -> None:
        """Nothing is held."""

    @property
    def monitor(self) -> Monitor:
        """All that can be seen of this car, under the inputs of the last step."""
        glance(self._state, *self._input, self.parameters, self._seen)
        return Monitor(*self._seen.tolist())

    @property
    def state_vector(self) -> NDArray[float64]:
        """A copy of the whole state; see `sim_bridge.plant.states`."""
        return self._state.copy()


def _whole_steps(dt_s: float) -> int:
    n_steps = round(dt_s / STEP_S)
    if n_steps < 1 or abs(n_steps * STEP_S - dt_s) > 1e-9:
        raise ConfigError(
            f"a step of {dt_s} s: expected a whole number of the car's own steps of {STEP_S} s, "
            f"found {dt_s / STEP_S:g}. Choose a multiple of it."
        )
    return n_steps
