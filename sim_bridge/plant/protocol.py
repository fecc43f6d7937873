"""`Plant`: the methods of every simulated car behind the bridge.

A plant is the car alone, without a road: its step returns the motion of its centre of gravity.
`sim_bridge.car` places it on a road; `sim_bridge.adapters` holds the implementations.
"""

from math import nan
from typing import NamedTuple, Protocol, runtime_checkable

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput

FASTEST_START_MPS = 70.0
"""faster than any car that is meant here; a speed in km/h by mistake is refused"""
MOTION_FIELDS = ("vx_mps", "vy_mps", "yaw_rate_radps")
"""columns of a motion array"""


class RoadAt(NamedTuple):
    """The ground and the air at the place of the car, constant over one period."""

    curvature_per_m: float  # of the reference line, positive to the left
    curvature_change_per_m2: float  # derivative of the curvature with respect to arc length
    friction_left: float  # under the left wheels; 1 is the road of the tyre test
    friction_right: float
    bank_rad: float  # cross slope, positive if the left side of the road is higher
    grade_rad: float  # positive uphill
    wind_forward_mps: float  # speed of the air over ground along the car, positive: tail wind
    wind_left_mps: float  # speed of the air over ground across the car, positive towards the left


class PlantOutputs(NamedTuple):
    """Further quantities of a car; NaN where a plant does not compute them.

    Positive roll lowers the right side, positive pitch the nose.
    """

    ax_mps2: float = nan  # acceleration of the centre of gravity, body axes
    ay_mps2: float = nan
    sideslip_rad: float = nan
    roll_rad: float = nan
    pitch_rad: float = nan
    gear: float = nan
    engine_rpm: float = nan
    throttle: float = nan  # throttle opening, after actuator lags
    brake_mpa: float = nan  # of the front circuit
    road_wheel_rad: float = nan
    """angle of the front wheels against the body with roll steer and compliance, their mean"""
    turbine_rpm: float = nan
    wind_up_rad: float = nan  # twist of the drive shafts
    travel_front_left_m: float = nan  # of each wheel towards the body
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
    accelerometer_forward_mps2: float = nan
    """reading of an accelerometer at the centre of gravity of the body, fixed to it: it contains
    gravity along its axis if the body pitches or the road has a grade"""
    accelerometer_left_mps2: float = nan  # the same to the left, with roll and bank
    steering_wheel_nm: float = nan
    """torque at the steering wheel without power assistance, positive to the left"""
    engine_nm: float = nan
    """torque at the crankshaft of the engine or the shaft of the electric motor"""


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


@runtime_checkable
class RoadTakingPlant(Protocol):
    """A plant that is told where its road changes; one without these names has a uniform road."""

    @property
    def road_inputs(self) -> frozenset[str]:
        """Names of the fields of `RoadAt` that act on this plant."""
        ...

    def set_road(self, road: RoadAt) -> None:
        """Take the ground of the coming period; called before each `step`."""
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


def require_start_speed(name: str, v0_mps: float) -> None:
    """Return if a car can start at this speed.

    Raises:
        ConfigError: it cannot; `name` is that of the plant.
    """
    if not 0.0 <= v0_mps <= FASTEST_START_MPS:
        raise ConfigError(
            f"{name}: initial speed: expected 0..{FASTEST_START_MPS:g} m/s, found {v0_mps:g}. The "
            f"car starts at rest or driving forward; a speed in km/h is divided by 3.6."
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
