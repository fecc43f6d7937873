"""`Plant`: the methods of every simulated car behind the bridge.

A plant is the car alone, without a road: its step returns the motion of its centre of gravity.
`sim_bridge.car` places it on a road; `sim_bridge.adapters` holds the implementations.
"""

from math import nan
from typing import NamedTuple, Protocol

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput

MOTION_FIELDS = ("vx_mps", "vy_mps", "yaw_rate_radps")
"""columns of a motion array"""


class PlantOutputs(NamedTuple):
    """Further quantities of a car; NaN where a plant does not compute them.

    Positive roll lowers the right side, positive pitch the nose.
    """

    ax_mps2: float = nan
    """acceleration of the centre of gravity, body axes"""
    ay_mps2: float = nan
    sideslip_rad: float = nan
    roll_rad: float = nan
    pitch_rad: float = nan
    gear: float = nan
    engine_rpm: float = nan
    throttle: float = nan
    """throttle opening, after actuator lags"""
    brake_mpa: float = nan
    """of the front circuit"""
    road_wheel_rad: float = nan
    """mean of the front wheels, positive to the left"""
    turbine_rpm: float = nan
    wind_up_rad: float = nan
    """twist of the drive shafts"""
    travel_front_left_m: float = nan
    """of each wheel towards the body"""
    travel_front_right_m: float = nan
    travel_rear_left_m: float = nan
    travel_rear_right_m: float = nan
    load_front_left_n: float = nan
    load_front_right_n: float = nan
    load_rear_left_n: float = nan
    load_rear_right_n: float = nan
    spin_front_left_radps: float = nan
    spin_front_right_radps: float = nan
    spin_rear_left_radps: float = nan
    spin_rear_right_radps: float = nan


class Plant(Protocol):
    """A car without a road.

    A plant whose computation fails does not raise: it returns NaN from then on and states the
    reason in `failure`, so that the bridge can report the failure on the bus.
    """

    @property
    def name(self) -> str:
        """Name of the plant for messages."""
        ...

    @property
    def failure(self) -> str | None:
        """Reason of the failure; None if the plant has not failed."""
        ...

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) at the start, driving straight ahead, settled.

        Raises:
            ConfigError: the plant cannot start at this speed.
        """
        ...

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion (vx_mps, vy_mps, yaw_rate_radps) after each of n equal parts of `dt_s`.

        The inputs are constant over `dt_s`; the plant chooses n. The array is contiguous and valid
        until the next step.
        """
        ...

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step."""
        ...

    def close(self) -> None:
        """Release libraries, folders and licences."""
        ...


def require_plant(plant: object) -> None:
    """Return if the object has all that a plant needs.

    Raises:
        ConfigError: names are missing, or it is a class and not an instance of one.
    """
    names = ("name", "failure", "reset", "step", "outputs", "close")
    missing = [name for name in names if not hasattr(plant, name)]
    if missing or isinstance(plant, type):
        found = f"no {', '.join(missing)}" if missing else "a class"
        raise ConfigError(
            f"plant: expected an instance of a class with {', '.join(names)}, found {found}. See "
            f"sim_bridge.Plant."
        )


def require_motion(motion: object, n_dimensions: int, call: str) -> None:
    """Return if a plant answered with an array (3,) or (n, 3).

    Raises:
        ConfigError: it answered with something else.
    """
    shape = getattr(motion, "shape", None)
    if shape is None or len(shape) != n_dimensions or shape[-1] != len(MOTION_FIELDS):
        wanted = "(3)" if n_dimensions == 1 else "(n, 3)"
        found = type(motion).__name__ if shape is None else f"the shape {shape}"
        raise ConfigError(
            f"plant.{call}: expected an array {wanted} of {', '.join(MOTION_FIELDS)}, found "
            f"{found}."
        )
