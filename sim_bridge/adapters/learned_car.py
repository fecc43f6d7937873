"""`LearnedCar`: the model of a bundle as the car, for a quick look at a model of one's own logs.

The model predicts the motion from one period to the next. Every two seconds, the longest
prediction that it was trained with, it begins again at its own last state. Below the speeds of its
data the car is kinematic: it rolls without sideslip, and its pedals have the gains of the slowest
speed.
"""

from math import tan

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import (
    AT_REST,
    NEUTRAL_INPUT,
    VEHICLE,
    ControlInput,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.identification import identify_gains
from rt_controller.control.lift import Encoder, History
from rt_controller.model.bundle import Bundle
from rt_controller.model.roll_outs import DrivenStep
from sim_bridge.plant.protocol import PlantOutputs, require_start_speed

LONGEST_STEPS = 80
SLOWEST_MPS = 5.0
"""of a model that does not know the speeds of its data"""
ROLLING_MPS2 = 0.1
"""deceleration of the kinematic car"""


class LearnedCar:
    """The motion that a model predicts; see `Plant` for the methods."""

    def __init__(self, bundle: Bundle, name: str) -> None:
        """`bundle` has the signals of the car.

        Raises:
            ConfigError: it has others.
            ArtifactError: its encoder cannot be opened.
        """
        if bundle.schema != VEHICLE:
            raise ConfigError(
                f"`plant` {name}: expected a model of the signals of the car, found one of others. "
                f"Train a model of the controller's states and inputs."
            )
        self.name, self.sha256 = name, bundle.sha256
        self.failure: str | None = None
        self._geometry = (bundle.car or UNNAMED_CAR).geometry
        slowest_mps = SLOWEST_MPS if bundle.validity is None else bundle.validity.speed_mps[0]
        self._slowest_mps = max(float(slowest_mps), 1.0)
        self._gains = identify_gains(bundle, self._slowest_mps)
        self._encoder, self._step = Encoder(bundle), DrivenStep(bundle)
        rows = self._encoder.history
        self._history = None if rows is None else History(rows)
        self._psi: Array | None = None
        self._steps = 0
        self._state, self._motion = AT_REST, np.zeros((1, 3))

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of a car that drives straight ahead.

        Raises:
            ConfigError: the speed is negative, too large or not a number.
        """
        require_start_speed(self.name, v0_mps)
        self.failure, self._psi = None, None
        self._state = AT_REST._replace(vx_mps=v0_mps, ds_m=v0_mps * PERIOD_S)
        if self._history is not None:
            self._history.forget()
            self._history.advance(self._state, NEUTRAL_INPUT)
        return np.array(self._state[:3])

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(1, 3) motion after a period; the model has no other step."""
        if abs(dt_s - PERIOD_S) > 1e-9:
            self.failure = f"{self.name}: a step of {dt_s:g} s, the model has {PERIOD_S:g} s"
        elif self._state.vx_mps < self._slowest_mps:
            self._psi = None
            self._state = self._roll(control)
        else:
            self._state = self._predict(control)
        if self._history is not None:
            self._history.advance(self._state, control)
        self._motion[0] = np.nan if self.failure else self._state[:3]
        return self._motion

    def outputs(self) -> PlantOutputs:
        """Nothing: the model knows the motion only."""
        return PlantOutputs()

    def close(self) -> None:
        """Do nothing: there are no resources."""

    def _predict(self, control: ControlInput) -> VehicleState:
        """Paper: eq. (8), on a straight road."""
        if self._psi is None or self._steps == LONGEST_STEPS:
            self._psi, self._steps = self._encoder.lift(self._state, 0.0).copy(), 0
        self._psi = self._step(self._psi, control, 0.0)
        self._steps += 1
        vx_mps, vy_mps, yaw_rate_radps = self._psi[:3].tolist()
        return _moving(max(vx_mps, 0.0), vy_mps, yaw_rate_radps)

    def _roll(self, control: ControlInput) -> VehicleState:
        gains, geometry = self._gains, self._geometry
        along_mps2 = control.throttle * gains.throttle_mps2 - ROLLING_MPS2
        along_mps2 -= control.brake_n * gains.brake_mps2_per_n
        vx_mps = max(self._state.vx_mps + PERIOD_S * along_mps2, 0.0)
        front_rad = control.steer_rad / geometry.steering_ratio
        yaw_rate_radps = vx_mps * tan(front_rad) / geometry.wheelbase_m
        return _moving(vx_mps, geometry.rear_axle_m * yaw_rate_radps, yaw_rate_radps)


def _moving(vx_mps: float, vy_mps: float, yaw_rate_radps: float) -> VehicleState:
    return VehicleState(vx_mps, vy_mps, yaw_rate_radps, vx_mps * PERIOD_S, 0.0, 0.0)
