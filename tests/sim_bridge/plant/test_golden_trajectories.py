"""The car moves as recorded, and compiles without a warning."""

from ctypes import byref, c_int
from pathlib import Path

import numpy as np
from golden_drives import GOLDEN_FILE, trajectories

from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.compiler import SOURCES, compile_library
from sim_bridge.plant.library import N_OUTPUTS, car_library, settle, simulate
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.states import N_STATES

STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Werror")


def test_the_car_moves_as_recorded() -> None:
    """To the last bit, unless the mathematical library rounds otherwise."""
    found, golden = trajectories(settle, simulate), np.load(GOLDEN_FILE)
    assert sorted(found) == sorted(golden.files)
    for name in golden.files:
        np.testing.assert_allclose(found[name], golden[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_structs_of_the_car_in_c_are_the_records_of_python() -> None:
    found = [c_int() for _ in range(3)]
    car_library().car_sizes(*map(byref, found))
    sizes = [N_STATES, len(car_record(default_car())), N_OUTPUTS]
    assert [each.value for each in found] == sizes


def test_the_car_compiles_without_a_warning(tmp_path: Path) -> None:
    compile_library(sorted(SOURCES.glob("*.c")), tmp_path / "car.so", STRICT)
