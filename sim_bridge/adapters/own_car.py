"""`OwnCar`: the project's own car model as a plant."""

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, advance, settle
from sim_bridge.plant.outputs import N_OUTPUTS, write_outputs
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT


class OwnCar:
    """The nonlinear car of `sim_bridge.plant`; see `Plant` for the methods."""

    def __init__(self, parameters: Parameters, name: str = "own car") -> None:
        self.name = name
        self.failure: str | None = None
        self.parameters = parameters
        self._state = np.empty(0)
        self._motion = np.empty((STEPS_PER_PERIOD, 3))
        self._outputs = np.empty(N_OUTPUTS)
        self._input = NEUTRAL_INPUT

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of the settled car."""
        self._state = settle(v0_mps, self.parameters)
        self._input = NEUTRAL_INPUT
        return self._state[[AT.vx_mps, AT.vy_mps, AT.yaw_rate_radps]]

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion on the grid of `STEP_S`.

        Raises:
            ConfigError: `dt_s` is no whole number of steps.
        """
        n_steps = round(dt_s / STEP_S)
        if n_steps != self._motion.shape[0]:
            if n_steps < 1 or abs(n_steps * STEP_S - dt_s) > 1e-9:
                raise ConfigError(
                    f"a step of {dt_s} s: expected a whole number of the car's own steps of "
                    f"{STEP_S} s, found {dt_s / STEP_S:g}. Choose a multiple of it."
                )
            self._motion = np.empty((n_steps, 3))
        self._input = control
        advance(self._state, control, self.parameters, n_steps, STEP_S, self._motion)
        return self._motion

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step."""
        write_outputs(self._state, self._input, self.parameters, self._outputs)
        return PlantOutputs(*self._outputs.tolist())

    def close(self) -> None:
        """Do nothing: there are no resources."""
