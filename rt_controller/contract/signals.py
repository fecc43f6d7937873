"""Order, names and units of every vector that the packages exchange.

The `_fields` of these tuples are the vector order everywhere: in arrays and in the model
bundle. An array's column is named by `StateColumn` or `InputColumn`, never by its number. SI
units; the unit is the end of each name.
Paper: eq. (2), "set of states and inputs".
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from rt_controller.contract.timing import PERIOD_S

GRAVITY_MPS2 = 9.80665
"""standard gravity"""


class VehicleState(NamedTuple):
    """The car in the Frenet frame of its road, sampled once a period.

    vx_mps: longitudinal velocity of the centre of gravity, body axes.
    vy_mps: lateral velocity of the centre of gravity, body axes, positive to the left.
    yaw_rate_radps: yaw rate, positive counter-clockwise.
    ds_m: progress along the road in the last period, s_k - s_(k-1).
    ey_m: lateral deviation from the road's reference line, positive to the left.
    epsi_rad: heading relative to the tangent of the reference line, positive counter-clockwise.
    """

    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float
    ds_m: float
    ey_m: float
    epsi_rad: float


AT_REST = VehicleState(*[0.0] * len(VehicleState._fields))
"""a standing car on its reference line"""


class StateColumn(IntEnum):
    """Column of each state in an array (..., n_x) in the order of `VehicleState`."""

    vx_mps = 0
    vy_mps = 1
    yaw_rate_radps = 2
    ds_m = 3
    ey_m = 4
    epsi_rad = 5


MOTION = slice(StateColumn.vx_mps, StateColumn.yaw_rate_radps + 1)
"""columns of the states that the car's own motion consists of"""
PATH_STATES = slice(StateColumn.ds_m, StateColumn.epsi_rad + 1)
"""columns of the states that describe the car's place on its road"""


class ControlInput(NamedTuple):
    """Pedals and steering wheel: held constant over one period.

    throttle: accelerator pedal, 0 to 1.
    brake_n: force on the brake pedal, 0 to 150 N.
    steer_rad: angle of the steering *wheel*, positive to the left; that of a plan up to
        300 deg, by the speed.
    """

    throttle: float
    brake_n: float
    steer_rad: float


class InputColumn(IntEnum):
    """Column of each input in an array (..., m) in the order of `ControlInput`."""

    throttle = 0
    brake_n = 1
    steer_rad = 2


NEUTRAL_INPUT = ControlInput(throttle=0.0, brake_n=0.0, steer_rad=0.0)
"""both pedals released, wheel straight"""


class PathReference(NamedTuple):
    """The path ahead, as the lane polynomial of a camera, in road coordinates.

    The reference lateral deviation at arc length sigma ahead of the car is
    e_y(sigma) = c0 + c1 sigma + c2 sigma^2 + c3 sigma^3, in metres and positive to the left; the
    reference speed t seconds ahead is v + a t.
    """

    c0_m: float
    c1: float
    c2_per_m: float
    c3_per_m2: float
    v_mps: float
    a_mps2: float

    def ey_at(self, ahead_m: float) -> float:
        """Lateral position in m of the path so far ahead of the car."""
        c0, c1, c2, c3, *_ = self
        return c0 + ahead_m * (c1 + ahead_m * (c2 + ahead_m * c3))


class CurvaturePreview(NamedTuple):
    """Curvature of the road's reference line ahead of the car, positive to the left.

    k0 to k4 are its values 0, 1, … 4 spacings ahead, along the line. Between them it is linear, as
    in a clothoid; behind the last it is constant. A sender may add to k1 to k4 what the cubic
    of its path lacks. `preview.fit_preview` makes one from a map.
    """

    spacing_m: float
    """above 0"""
    k0_per_m: float
    """at the car"""
    k1_per_m: float
    k2_per_m: float
    k3_per_m: float
    k4_per_m: float

    def curvature_at(self, spacings: float) -> float:
        """Curvature in 1/m so many spacings ahead of the car."""
        place = max(spacings, 0.0)
        if place >= 4.0:
            return self.k4_per_m
        knot = int(place)
        k0, k1 = self[1 + knot], self[2 + knot]
        return k0 + (place - knot) * (k1 - k0)


class Mode(IntEnum):
    """Mode of the controller; sent in ACT_CMD and CTRL_HB."""

    STANDBY = 0
    """no mission: pedals released, wheel where the car has it, or returned to the middle"""
    NOMINAL = 1
    """the first input of this tick's plan is sent"""
    HOLD_PLAN = 2
    """the next input of the last good plan is sent"""
    SAFE_STOP = 3
    """throttle closed, brake ramped; left only on an explicit request"""
    LOW_SPEED = 4
    """the low-speed law drives: the model is not trained for this speed"""
    STANDSTILL = 5
    """the brake holds the car, the wheel stays where it is"""

    @property
    def drives(self) -> bool:
        """True if the input of this tick was made from this tick's state and path."""
        return self in (Mode.NOMINAL, Mode.LOW_SPEED, Mode.STANDSTILL)

    @property
    def closes_throttle(self) -> bool:
        """True if every command of this mode has a closed throttle."""
        return self in (Mode.STANDBY, Mode.SAFE_STOP, Mode.STANDSTILL)


class Signal(NamedTuple):
    """One column of numbers."""

    name: str
    """ends in the unit where there is one"""
    unit: str


@dataclass(frozen=True, slots=True)
class Schema:
    """Names, order, units and period of the signals of a model."""

    states: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    exogenous: tuple[Signal, ...]
    """known ahead but not chosen by the controller"""
    dt_s: float

    @property
    def state_names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.inputs)

    @property
    def exogenous_names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.exogenous)

    @property
    def units(self) -> dict[str, str]:
        """Of all signals, by name."""
        return dict((*self.states, *self.inputs, *self.exogenous))


VEHICLE = Schema(
    states=tuple(map(Signal, VehicleState._fields, ("m/s", "m/s", "rad/s", "m", "m", "rad"))),
    inputs=tuple(map(Signal, ControlInput._fields, ("1", "N", "rad"))),
    exogenous=(Signal("curvature_per_m", "1/m"),),
    dt_s=PERIOD_S,
)
"""of the car in the Frenet frame of its road"""
SYMBOLS = {"vx": "v_x", "vy": "v_y", "yaw_rate": "yaw rate", "ds": "Δs", "ey": "e_y", "epsi": "e_ψ"}
"""of the states in tables, by their names without the unit"""
N_STATES = len(VEHICLE.states)
N_INPUTS = len(VEHICLE.inputs)
N_EXOGENOUS = len(VEHICLE.exogenous)
