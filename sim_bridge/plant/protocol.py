"""What every plant offers, whoever wrote it: start at a speed, drive a while, be looked at.

A plant is the car alone, without a road: it answers held inputs with the motion of its centre of
gravity. `sim_bridge.car` puts it on a road; `sim_bridge.adapters` has the plants.
"""

from math import nan
from typing import NamedTuple, Protocol

from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.signals import ControlInput


class PlantOutputs(NamedTuple):
    """What can be seen of a car beside its motion; NaN where a plant does not know.

    Positive roll lowers the right side, positive pitch the nose.
    """

    ax_mps2: float = nan
    """acceleration of the centre of gravity, body axes"""
    ay_mps2: float = nan
    roll_rad: float = nan
    pitch_rad: float = nan
    road_wheel_rad: float = nan
    """mean of the front wheels, positive to the left"""
    throttle: float = nan
    """as opened, behind whatever delays it"""
    brake_mpa: float = nan
    gear: float = nan
    engine_rpm: float = nan
    load_front_left_n: float = nan
    load_front_right_n: float = nan
    load_rear_left_n: float = nan
    load_rear_right_n: float = nan


class Plant(Protocol):
    """A car without a road.

    A plant whose computation fails does not raise: it keeps answering with NaN and says why in
    `failure`, so that the loop around it can tell the other end of the bus.
    """

    @property
    def name(self) -> str:
        """Which plant this is, for people."""
        ...

    @property
    def failure(self) -> str | None:
        """Why there are no numbers any more; None as long as there are."""
        ...

    def reset(self, v0_mps: float) -> NDArray[float64]:
        """(vx_mps, vy_mps, yaw_rate_radps) of a car that starts anew, straight ahead and settled.

        Raises:
            ConfigError: the plant cannot start at this speed.
        """
        ...

    def step(self, control: ControlInput, dt_s: float) -> NDArray[float64]:
        """(n, 3) motion (vx_mps, vy_mps, yaw_rate_radps) after each of n equal parts of `dt_s`.

        The inputs hold over `dt_s`; n is the plant's own choice. The array is contiguous and good
        until the next step.
        """
        ...

    def outputs(self) -> PlantOutputs:
        """What the last step ended with."""
        ...

    def close(self) -> None:
        """Give back what the plant holds: libraries, folders, licences."""
        ...
