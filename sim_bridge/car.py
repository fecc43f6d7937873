"""A car on its road: any plant and the road frame, advanced together."""

from math import cos, isfinite, sin
from typing import NoReturn

import numpy as np

from rt_controller.contract.errors import PlantError, RtControllerError
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S
from sim_bridge import frenet
from sim_bridge.plant.protocol import Plant, RoadAt, RoadTakingPlant, require_motion
from sim_bridge.scenario.table import Table, constant

FASTEST_MPS = 100.0
"""end of the range of VelocityX in `messages.dbc`"""


class Car:
    """A simulated car in the Frenet frame of a road; inputs are held over each step."""

    def __init__(self, plant: Plant, v0_mps: float) -> None:
        self.plant = plant
        self._road_plant = plant if isinstance(plant, RoadTakingPlant) else None
        self._before = np.empty(3)
        self._pose = np.zeros(3)
        self.state = AT_REST
        """at the end of the last period"""
        self.first_input = NEUTRAL_INPUT
        """that acts until a controller drives"""
        self.reset(v0_mps)

    def reset(
        self, v0_mps: float, ey_m: float = 0.0, epsi_rad: float = 0.0, s_m: float = 0.0
    ) -> VehicleState:
        """The state after a restart: driving straight ahead with everything settled.

        Its progress is that of a period before the start, driven equally on a straight road.

        Raises:
            PlantError: the plant raised an exception.
            ConfigError: the plant cannot start at this speed, or did not return an array (3).
        """
        try:
            motion = self.plant.reset(v0_mps)
            require_motion(motion, 1, "reset")
        except Exception as error:
            self._raise_named(f"the reset to {v0_mps:.2f} m/s", error)
        self._before[:] = motion
        self._pose[:] = (s_m, ey_m, epsi_rad)
        self._steps, self.first_input = 0, NEUTRAL_INPUT
        velocities = self._before.tolist()
        ds_m = velocities[0] * cos(epsi_rad) * PERIOD_S
        self.state = VehicleState._make((*velocities, ds_m, ey_m, epsi_rad))
        return self.state

    def begin_here(self, s_m: float, ey_m: float, epsi_rad: float, control: ControlInput) -> None:
        """Take the present motion as that of the start, at this place and with this input."""
        self._pose[:] = (s_m, ey_m, epsi_rad)
        self._steps, self.first_input = 0, control
        self.state = self.state._replace(ey_m=ey_m, epsi_rad=epsi_rad)

    def set_road(self, road: RoadAt) -> None:
        """Tell the plant the ground and the air of the coming period, if it takes them.

        `road` is that of a car parallel to the road; the wind is turned into the axes of this one.
        """
        if self._road_plant is None:
            return
        forward_mps, left_mps = road.wind_forward_mps, road.wind_left_mps
        if forward_mps or left_mps:
            c, s = cos(self.state.epsi_rad), sin(self.state.epsi_rad)
            forward_mps, left_mps = (c * forward_mps + s * left_mps, c * left_mps - s * forward_mps)
            road = road._replace(wind_forward_mps=forward_mps, wind_left_mps=left_mps)
        self._road_plant.set_road(road)

    def advance(
        self, control: ControlInput, curvature: float | Table, dt_s: float = PERIOD_S
    ) -> VehicleState:
        """The state `dt_s` later; all NaN once the plant has failed.

        Args:
            control: constant over this time.
            curvature: of the reference line in 1/m, a constant or a table over arc length.
            dt_s: of the step.

        Raises:
            PlantError: the plant raised an exception.
            ConfigError: the first step did not return an array (n, 3).
        """
        if isinstance(curvature, float):
            curvature = constant(curvature)
        s_before_m = float(self._pose[frenet.S])
        self._steps += 1
        try:
            motion = self.plant.step(control, dt_s)
            if self._steps == 1:
                require_motion(motion, 2, "step")
        except Exception as error:
            self._raise_named(f"step {self._steps} after the start", error)
        step_s = dt_s / motion.shape[0]
        frenet.advance_along(self._before, motion, curvature, step_s, self._pose)
        self._before[:] = motion[-1]
        s_m, ey_m, epsi_rad = self._pose.tolist()
        self.state = VehicleState._make((*self._before.tolist(), s_m - s_before_m, ey_m, epsi_rad))
        return self.state

    @property
    def is_sound(self) -> bool:
        """True if the state is finite, and the speed one that `messages.dbc` can carry."""
        return isfinite(sum(self.state)) and self.state.vx_mps <= FASTEST_MPS

    def _raise_named(self, call: str, error: Exception) -> NoReturn:
        if isinstance(error, RtControllerError):
            raise error
        raise PlantError(
            f"plant {self.plant.name}: expected a motion from {call}, found "
            f"{type(error).__name__}: {error}. A plant that fails returns NaN and states the "
            f"reason in `failure`."
        ) from error

    @property
    def s_m(self) -> float:
        """Arc length of the road at the car."""
        return float(self._pose[frenet.S])
