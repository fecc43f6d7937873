"""The car moves as recorded, in Python and in C."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from c_compiler import needs_c_compiler
from golden_drives import GOLDEN_FILE, golden_cars, trajectories

import sim_bridge.plant
from rt_controller.contract.arrays import Array
from sim_bridge.fmu_export.compiler import compile_library
from sim_bridge.plant import integrate
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.outputs import N_OUTPUTS
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.shipped_cars import DEFAULT_CAR
from sim_bridge.plant.states import N_STATES

SOURCES = sorted((Path(sim_bridge.plant.__file__).parent / "c").glob("*.c"))
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Werror", "-fvisibility=default")


class CCar:
    """The compiled car, with the functions of `integrate`."""

    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))

    def sizes(self) -> list[int]:
        """Doubles of a state, of the parameters with the road, and of the outputs."""
        found = [ctypes.c_int() for _ in range(3)]
        self._library.car_sizes(*map(ctypes.byref, found))
        return [each.value for each in found]

    def settle(self, v0_mps: float, p: Parameters) -> Array:
        state = np.zeros(N_STATES)
        record = np.array(car_record(p))
        self._library.car_settle(ctypes.c_double(v0_mps), _pointer(record), _pointer(state))
        return state

    def simulate(
        self, state0: Array, inputs: Array, p: Parameters, steps: int, step_s: float, roads: Array
    ) -> tuple[Array, Array]:
        state, record, periods = state0.copy(), np.array(car_record(p)), len(inputs)
        inputs, roads = np.ascontiguousarray(inputs), np.ascontiguousarray(roads)
        motion = np.empty((periods * steps + 1, 3))
        outputs = np.empty((periods + 1, N_OUTPUTS))
        numbers = (periods, steps, ctypes.c_double(step_s))
        given = [_pointer(each) for each in (state, inputs, roads, record)]
        self._library.car_simulate(*given, *numbers, _pointer(motion), _pointer(outputs))
        return motion, outputs


def _pointer(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


@pytest.fixture(scope="module")
def c_car(tmp_path_factory: pytest.TempPathFactory) -> CCar:
    library = tmp_path_factory.mktemp("car") / "car.so"
    compile_library(SOURCES, library, STRICT)
    return CCar(library)


def require_golden(found: dict[str, Array]) -> None:
    """To the last bit, unless the mathematical library rounds otherwise."""
    golden = np.load(GOLDEN_FILE)
    assert sorted(found) == sorted(golden.files)
    for name in golden.files:
        np.testing.assert_allclose(found[name], golden[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_the_car_moves_as_recorded() -> None:
    require_golden(trajectories(integrate.settle, integrate.simulate))


@needs_c_compiler
def test_the_car_in_c_moves_as_recorded(c_car: CCar) -> None:
    require_golden(trajectories(c_car.settle, c_car.simulate))


@needs_c_compiler
def test_structs_of_the_car_in_c_are_the_records_of_python(c_car: CCar) -> None:
    record = np.array(car_record(golden_cars()[DEFAULT_CAR]))
    assert c_car.sizes() == [N_STATES, record.nbytes // 8, N_OUTPUTS]
