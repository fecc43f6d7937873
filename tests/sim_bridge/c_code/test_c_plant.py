"""The plant in C is the plant of numba.

After every control period each state x, in SI units, fulfils |x_C - x_numba| <= 1e-9 max(1,
|x_numba|).
"""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from c_compiler import needs_c_compiler
from c_library import CLibrary, build, filled
from made_tyre import TYRE_FILE_TEXT

from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge import frenet
from sim_bridge.plant import integrate, outputs
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import N_OUTPUTS, STEP_S, STEPS_PER_PERIOD
from sim_bridge.plant.parameters import Parameters, load_parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.plant.states import AT, N_STATES, N_WHEELS
from sim_bridge.plant.tyre_file import NO_TYRE_FILE, TyreFileParameters, parse_tyre_file

pytestmark = needs_c_compiler

TOLERANCE = 1e-9
N_PERIODS = 160
_STATE, _MOTION, _ROW = np.zeros(N_STATES), np.zeros((STEPS_PER_PERIOD, 3)), np.zeros(N_OUTPUTS)


class Drive(NamedTuple):
    """A start and a kind of driver."""

    v0_mps: float
    road: RoadParameters
    throttle: float
    """largest"""
    brake_n: float
    wheel_rad: float
    tyre_file: TyreFileParameters = NO_TYRE_FILE


_SLOPES = RoadParameters(0.85, 0.7, -0.08, 0.12, wind_forward_mps=-9.0, wind_left_mps=7.0)
_TYRE = parse_tyre_file(TYRE_FILE_TEXT, "made")
DRIVES = {
    "from rest at full throttle": Drive(0.0, RoadParameters(0.9, 0.9), 1.0, 0.0, 0.3),
    "to rest": Drive(8.0, RoadParameters(0.85, 0.85), 0.0, 150.0, 0.5),
    "locked on ice": Drive(25.0, RoadParameters(0.15, 0.15), 0.2, 400.0, 2.0),
    "left on asphalt, right on snow": Drive(30.0, RoadParameters(0.9, 0.3), 0.6, 250.0, 1.0),
    "limit handling": Drive(35.0, RoadParameters(0.85, 0.85), 1.0, 200.0, 2.0),
    "through the gears": Drive(12.0, RoadParameters(1.0, 1.0), 1.0, 60.0, 0.1),
    "up a banked road in the wind": Drive(20.0, _SLOPES, 1.0, 200.0, 1.0),
    "with the tyres of a file": Drive(25.0, _SLOPES, 1.0, 200.0, 1.5, _TYRE),
}


def inputs_of(drive: Drive, rng: np.random.Generator) -> list[ControlInput]:
    """Pedals and wheel, new every half second."""
    inputs = []
    for _ in range(N_PERIODS // 20):
        is_braking = rng.random() < (1.0 if drive.throttle == 0.0 else 0.4)
        pedals = (0.0, drive.brake_n) if is_braking else (drive.throttle, 0.0)
        throttle, brake_n = (float(rng.uniform(0.5, 1.0) * pedal) for pedal in pedals)
        wheel_rad = float(rng.uniform(-drive.wheel_rad, drive.wheel_rad))
        inputs += [ControlInput(throttle, brake_n, wheel_rad)] * 20
    return inputs


@pytest.fixture(scope="module", params=shipped_cars())
def car(request: pytest.FixtureRequest) -> Parameters:
    return load_parameters(request.param)


@pytest.fixture(scope="module")
def library(car: Parameters, tmp_path_factory: pytest.TempPathFactory) -> CLibrary:
    shown = [
        (integrate._settle, (20.0, car)),
        (integrate.advance, (_STATE, NEUTRAL_INPUT, car, 1, STEP_S, _MOTION)),
        (outputs.write_outputs, (_STATE, NEUTRAL_INPUT, car, _ROW)),
    ]
    return build(tmp_path_factory.mktemp("plant"), shown, car)


def assert_close(in_c: np.ndarray, in_numba: np.ndarray) -> None:
    np.testing.assert_array_less(
        np.abs(in_c - in_numba), TOLERANCE * np.maximum(1.0, np.abs(in_numba)) + 1e-300
    )


def test_drives_are_equal(car: Parameters, library: CLibrary) -> None:
    seen = set()
    for number, drive in enumerate(DRIVES.values()):
        parameters = with_road(car, drive.road)._replace(tyre_file=drive.tyre_file)
        kinds = library.kinds(integrate.advance)
        in_c = filled(kinds[2], parameters)
        state = integrate.settle(drive.v0_mps, parameters)
        record = car_record(parameters)
        c_state = np.zeros(N_STATES)
        library.call_with_storage(integrate._settle, [c_state], drive.v0_mps, in_c)
        assert_close(c_state, state)
        motion, c_motion = _MOTION.copy(), _MOTION.copy()
        row, c_row = _ROW.copy(), _ROW.copy()
        gear = state[AT.gear]
        for control in inputs_of(drive, np.random.default_rng(number)):
            integrate.advance(state, control, record, STEPS_PER_PERIOD, STEP_S, motion)
            library.call(
                integrate.advance, c_state, control, in_c, STEPS_PER_PERIOD, STEP_S, c_motion
            )
            assert_close(c_state, state)
            assert_close(c_motion, motion)
            spins = state[AT.spin_radps : AT.spin_radps + N_WHEELS]
            seen |= {"shift"} if state[AT.gear] != gear else set()
            seen |= {"locked"} if state[AT.vx_mps] > 2.0 and (spins == 0.0).any() else set()
            seen |= {"rest"} if abs(state[AT.vx_mps]) < 0.01 else set()
            gear = state[AT.gear]
        outputs.write_outputs(state, control, record, row)
        library.call(outputs.write_outputs, c_state, control, in_c, c_row)
        assert_close(c_row, row)
    wanted = {"rest"}
    wanted |= {"shift"} if len(set(car.gearbox.ratios)) > 1 else set()
    wanted |= set() if car.anti_lock.slip > 0.0 else {"locked"}
    assert seen >= wanted, "the drives do not show what they should"


def test_the_road_frame_is_equal(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    before, pose = np.array([20.0, 0.1, 0.05]), np.array([0.0, 0.3, 0.02])
    motion = before + 0.1 * rng.standard_normal((25, 3))
    c_pose = pose.copy()
    library = build(tmp_path, [(frenet.advance_interval, (before, motion[0], 0.01, STEP_S, pose))])
    for start, end in pairwise((before, *motion)):
        library.call(frenet.advance_interval, start, end, 0.01, STEP_S, c_pose)
        frenet.advance_interval(start, end, 0.01, STEP_S, pose)
    assert_close(c_pose, pose)
