"""`OwnCar`: the project's own car model as a plant."""

from operator import attrgetter

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.plant.library import (
    N_OUTPUTS,
    STEP_S,
    STEPS_PER_PERIOD,
    advance,
    car_record,
    set_road,
    settle,
    write_outputs,
)
from sim_bridge.plant.parameters import Parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import PlantOutputs, RoadAt
from sim_bridge.plant.states import AT

_GROUND = attrgetter(*RoadParameters._fields)


def ground_at(road: RoadAt) -> RoadParameters:
    """What the own car takes of a road."""
    return RoadParameters(*_GROUND(road))


class OwnCar:
    """The nonlinear car of `sim_bridge.plant`; see `Plant` for the methods."""

    road_inputs = frozenset(RoadParameters._fields)
    """fields of `RoadAt` that act on this car"""

    def __init__(self, parameters: Parameters, name: str = "own car") -> None:
        self.name, self.parameters = name, parameters
        self.failure: str | None = None
        self._first_ground = parameters.road
        self._record = car_record(parameters)
        self._state = np.empty(0)
        self._motion = np.empty((STEPS_PER_PERIOD, 3))
        self._outputs = np.empty(N_OUTPUTS)
        self._input = NEUTRAL_INPUT

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of the car settled on the road of its construction."""
        self._drive_on(self._first_ground)
        self._state = settle(v0_mps, self.parameters)
        self._input = NEUTRAL_INPUT
        return self._state[[AT.vx_mps, AT.vy_mps, AT.yaw_rate_radps]]

    def set_road(self, road: RoadAt) -> None:
        """Drive on this ground from now on."""
        self._drive_on(ground_at(road))

    def _drive_on(self, ground: RoadParameters) -> None:
        if ground != self.parameters.road:
            self.parameters = with_road(self.parameters, ground)
            set_road(self._record, ground)

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion on the grid of `STEP_S`, of which `dt_s` is a multiple."""
        n_steps = round(dt_s / STEP_S)
        if n_steps != self._motion.shape[0]:
            self._motion = np.empty((n_steps, 3))
        self._input = control
        advance(self._state, control, self._record, n_steps, STEP_S, self._motion)
        return self._motion

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step."""
        write_outputs(self._state, self._input, self._record, self._outputs)
        return PlantOutputs(*self._outputs.tolist())

    def close(self) -> None:
        """Do nothing: there are no resources."""
