"""The compiled car from Python: settling, motion, outputs, and the forces of single parts.

Its C is in `c/`, compiled when the package is installed. In a checkout whose sources have changed
since, it is compiled again at the first use.
"""

import ctypes
from collections.abc import Iterator
from ctypes import byref, c_char, c_double, c_int, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.compiler import built_library
from rt_controller.contract.files import user_cache_folder
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.compiler import BUILT, car_library_name, compile_car
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import PlantOutputs, require_start_speed
from sim_bridge.plant.states import N_STATES

STEP_S = 0.001
"""of the integration; with longer steps stiff tyres on light wheels are unstable"""
STEPS_PER_PERIOD = round(PERIOD_S / STEP_S)
N_OUTPUTS = len(PlantOutputs._fields)
_PARTS = [*Parameters.__annotations__.values()]
_ROAD = sum(len(part._fields) for part in _PARTS[: Parameters._fields.index("road")])
"""place of its first number"""


class _Numbers:
    """An argument that is an array of float64 in one piece, as `numpy.ctypeslib.ndpointer`, which
    takes four times as long."""

    @staticmethod
    def from_param(array: Any) -> object:
        if array.dtype != np.float64:
            raise TypeError(f"expected numbers of float64, found {array.dtype}")
        return byref(c_char.from_buffer(array))


_ARGUMENTS: dict[str, tuple[type, ...]] = {
    "car_settle": (c_double, _Numbers, _Numbers),
    "car_advance": (_Numbers, _Numbers, _Numbers, c_int, c_double, _Numbers),
    "car_outputs": (_Numbers, _Numbers, _Numbers, _Numbers),
    "car_simulate": (*4 * (_Numbers,), c_int, c_int, c_double, _Numbers, _Numbers),
    "car_tyre_force": (*5 * (c_double,), _Numbers, _Numbers),
    "car_steady_pressures": (c_double, _Numbers, _Numbers),
    "road_advance": (_Numbers, _Numbers, c_int, c_void_p, c_double, _Numbers),
    "road_poses": (_Numbers, c_int, c_int, c_void_p, c_double, _Numbers),
}


@cache
def car_library() -> ctypes.CDLL:
    """The loaded library, with the types of the arguments of its functions.

    Raises:
        MissingExtraError: it is not compiled, and this machine cannot compile it.
    """
    library = ctypes.CDLL(str(_library_file()))
    for name, arguments in _ARGUMENTS.items():
        function = getattr(library, name)
        function.argtypes, function.restype = arguments, None
    return library


def _library_file() -> Path:
    """The compiled car; compiled now, if it is in none of the folders that may have it."""
    user_cache = user_cache_folder()
    folders = [BUILT, *([user_cache / "car"] if user_cache else [])]
    return built_library("simulated car", car_library_name(), folders, compile_car)


def car_record(parameters: Parameters) -> Array:
    """(434,) all numbers of the car and its road, in the order of the named tuples."""
    return np.array([*_numbers(parameters)])


def set_road(record: Array, road: RoadParameters) -> None:
    """Write another road into a record, which takes less time than a new record."""
    record[_ROAD : _ROAD + len(road)] = road


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    else:
        yield value


def settle(v0_mps: float, p: Parameters) -> Array:
    """(N_STATES,) the state of a car that drives straight ahead at `v0_mps`, all others settled.

    Gear, engine, converter, slips, pitch and the throttle that keeps the speed result from 2 s of
    simulation in which the speed is kept constant. With `v0_mps` = 0 the brake is applied, because
    the converter would move the car, and the simulation lasts 6 s.

    Raises:
        ConfigError: the speed is negative, too large or not a number.
    """
    require_start_speed("own car", v0_mps)
    state = np.zeros(N_STATES)
    car_library().car_settle(v0_mps, car_record(p), state)
    return state


def advance(
    state: Array, control: ControlInput, record: Array, n_steps: int, step_s: float, motion: Array
) -> None:
    """Integrate `state` over `n_steps` under constant inputs, in place.

    Args:
        record: of the car, see `car_record`.
        motion: (n_steps, 3), filled with (vx_mps, vy_mps, yaw_rate_radps) of the centre of gravity
            after each step.
    """
    car_library().car_advance(state, np.array(control), record, n_steps, step_s, motion)


def write_outputs(state: Array, control: ControlInput, record: Array, row: Array) -> None:
    """Fill `row` (N_OUTPUTS,) with the fields of `PlantOutputs` under constant inputs.

    Below 0.5 m/s the sideslip is computed with 0.5 m/s: at rest it is not defined.
    """
    car_library().car_outputs(state, np.array(control), record, row)


def simulate(
    state0: Array,
    inputs: Array,
    p: Parameters,
    steps_per_period: int = STEPS_PER_PERIOD,
    step_s: float = STEP_S,
    roads: Array | None = None,
) -> tuple[Array, Array]:
    """Motion and outputs of a whole episode; `state0` is not changed.

    Args:
        inputs: (K, 3), columns as `ControlInput`, each row constant over a period.
        roads: (K, 6), columns as `RoadParameters`, likewise; None: the road of `p` throughout.

    Returns:
        motion: (K * steps_per_period + 1, 3), (vx_mps, vy_mps, yaw_rate_radps) on the fine grid.
        outputs: (K + 1, N_OUTPUTS), at the periods' ends, columns as `PlantOutputs._fields`.
    """
    n_periods = len(inputs)
    if roads is None:
        roads = np.tile(np.array(p.road), (n_periods, 1))
    state, record = state0.astype(float), car_record(p)
    given = [state, *(np.ascontiguousarray(table, dtype=float) for table in (inputs, roads))]
    motion = np.empty((n_periods * steps_per_period + 1, 3))
    outputs = np.empty((n_periods + 1, N_OUTPUTS))
    car_library().car_simulate(*given, record, n_periods, steps_per_period, step_s, motion, outputs)
    return motion, outputs


def steady_pressures_mpa(pedal_n: float, record: Array) -> tuple[float, float]:
    """(front, rear) brake pressures behind a pedal that is held."""
    pressures = np.empty(2)
    car_library().car_steady_pressures(pedal_n, record, pressures)
    front_mpa, rear_mpa = pressures.tolist()
    return front_mpa, rear_mpa
