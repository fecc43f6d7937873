"""The code inside an exported FMU: the own car behind pythonfmu's FMI 2 interface.

This file is copied into the FMU and loaded from there as a single file, so it imports all names by
their full path. The car's parameters are beside it as `car.toml`. The Python that loads the FMU
needs `rt-controller[sim]`.
"""

from math import isfinite, nan
from pathlib import Path
from typing import Any

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

from rt_controller.contract.errors import RtControllerError
from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.plant.integrate import STEP_S
from sim_bridge.plant.parameters import load_parameters, with_road_friction
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs


class Car(Fmi2Slave):
    """Inputs and outputs have the names of the contract; SI units, steering wheel angle."""

    author = "rt-controller"
    description = "The nonlinear car of sim_bridge, in steps of 1 ms"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.throttle = self.brake_n = self.steer_rad = 0.0
        self.v0_mps = 20.0
        self.road_friction = 0.85
        self.road_friction_right = 0.0
        self.vx_mps = self.vy_mps = self.yaw_rate_radps = nan
        self._outputs: PlantOutputs | None = PlantOutputs()
        self.car: OwnCar | None = None
        self.default_experiment = DefaultExperiment(start_time=0.0, step_size=STEP_S)
        parameters = ("v0_mps", "road_friction", "road_friction_right")
        for names, causality, variability in (
            (ControlInput._fields, Fmi2Causality.input, Fmi2Variability.continuous),
            (parameters, Fmi2Causality.parameter, Fmi2Variability.fixed),
            (MOTION_FIELDS, Fmi2Causality.output, Fmi2Variability.continuous),
        ):
            for name in names:
                variable = Real(name, causality=causality, variability=variability)
                self.register_variable(variable)
        for name in PlantOutputs._fields:
            self.register_variable(
                Real(
                    f"out_{name}",
                    causality=Fmi2Causality.output,
                    variability=Fmi2Variability.continuous,
                    getter=lambda name=name: getattr(self._current_outputs(), name),
                )
            )

    def exit_initialization_mode(self) -> None:
        """Settle the car with the parameters that were set."""
        parameters = load_parameters(Path(self.resources) / "car.toml")
        right = self.road_friction_right or None
        self.car = OwnCar(with_road_friction(parameters, self.road_friction, right))
        self.vx_mps, self.vy_mps, self.yaw_rate_radps = self.car.reset(self.v0_mps).tolist()
        self._outputs = None

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Compute a step; False if it is no whole number of the car's own steps, or fails."""
        if self.car is None:
            return False
        control = ControlInput(self.throttle, self.brake_n, self.steer_rad)
        try:
            motion = self.car.step(control, step_size)
        except RtControllerError as error:
            self.log(str(error), Fmi2Status.error)
            return False
        self.vx_mps, self.vy_mps, self.yaw_rate_radps = motion[-1].tolist()
        self._outputs = None
        return isfinite(self.vx_mps + self.vy_mps + self.yaw_rate_radps)

    def _current_outputs(self) -> PlantOutputs:
        """Computed at the first access after a step."""
        if self._outputs is None and self.car is not None:
            self._outputs = self.car.outputs()
        return self._outputs or PlantOutputs()
