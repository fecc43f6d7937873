"""Engine, gearbox, brakes and their helpers, by what they do to the car; how it is compiled."""

import ctypes
import shlex
from collections.abc import Iterator
from math import pi
from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.compiler import CompileError, find_compiler
from rt_controller.contract.errors import MissingExtraError
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from sim_bridge.plant import compiler, library
from sim_bridge.plant.compiler import compile_car
from sim_bridge.plant.library import (
    advance,
    car_record,
    settle,
    steady_pressures_mpa,
)
from sim_bridge.plant.parameters import Parameters, default_car, load_parameters, with_road_friction
from sim_bridge.plant.parts import NO_ANTI_LOCK, NO_TRACTION_CONTROL
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import Run, input_table, replay

CAR = default_car()
FRONT_DRIVE = load_parameters("c_class_125kw_fwd")
ELECTRIC = load_parameters("c_class_150kw_bev")
PERIOD_S = 0.025


def drive(
    car: Parameters, v0_kmh: float, seconds: float, throttle: Array | float = 0.0,
    brake_n: Array | float = 0.0,
) -> Run:  # fmt: skip
    """A drive straight ahead."""
    inputs = input_table(round(seconds / PERIOD_S), throttle, brake_n)
    return replay(car, v0_kmh / 3.6, inputs, PERIOD_S)


def rim_share(run: Run, car: Parameters) -> Array:
    """Speed of each rim over that of the car."""
    return run.spins_radps * car.tyre.rolling_radius_m / run.speed_mps[:, None]


@pytest.fixture(scope="module")
def full_throttle() -> Run:
    return drive(CAR, 0.0, 20.0, throttle=1.0)


def test_the_engine_has_its_published_torque(full_throttle: Run) -> None:
    """In the gears; where the power peaks the gearbox has shifted up."""
    speed_rpm, torque_nm = full_throttle.column("engine_rpm"), full_throttle.column("engine_nm")
    assert torque_nm.max() == pytest.approx(309.9, abs=0.2)
    assert speed_rpm[torque_nm.argmax()] == pytest.approx(3603.0, abs=20.0)
    assert speed_rpm.max() < 6000.0
    row = CAR.engine.map_nm[-1]
    at_5000_nm = np.interp(5000.0, CAR.engine.map_speeds_rpm, row)
    assert at_5000_nm * 5000.0 * pi / 30.0 == pytest.approx(151e3, rel=0.01)


@pytest.mark.parametrize("throttle", [0.3, 1.0])
def test_at_stall_engine_and_shafts_have_the_torque_of_the_converter(throttle: float) -> None:
    run = drive(CAR, 0.0, 3.0, throttle, brake_n=400.0)
    engine_nm, turbine_rpm = run.column("engine_nm")[-1], run.column("turbine_rpm")[-1]
    assert turbine_rpm == pytest.approx(0.0, abs=0.1)
    assert engine_nm == pytest.approx((0.00704 * run.column("engine_rpm")[-1]) ** 2, rel=1e-3)
    gear = CAR.gearbox.ratios[0] * CAR.gearbox.efficiencies[0] * CAR.driveline.final_ratio
    shafts_nm = CAR.driveline.shaft_stiffness_nmprad * run.column("wind_up_rad")[-1]
    assert shafts_nm == pytest.approx(1.864 * gear * engine_nm, rel=1e-3)


def test_full_throttle_shifts_up_one_by_one_with_a_dip_of_the_acceleration(
    full_throttle: Run,
) -> None:
    """During a shift it falls below that of the next gear and stays positive."""
    ax, gear = full_throttle.column("ax_mps2"), full_throttle.column("gear")
    assert set(np.diff(gear)) == {0.0, 1.0}
    assert gear[-1] >= 4.0
    for k in np.flatnonzero(np.diff(gear)):
        during = ax[k : k + 16]
        assert 0.0 < during.min() < ax[k + 20] < ax[k - 1]
        assert during.max() < 1.3 * ax[k - 1]
    assert np.all(np.diff(full_throttle.speed_mps[40:]) > 0.0)


def test_the_front_drive_car_drives_its_front_wheels_only() -> None:
    ice = with_road_friction(FRONT_DRIVE, 0.2)._replace(traction_control=NO_TRACTION_CONTROL)
    front_left, _, *rear = rim_share(drive(ice, 7.2, 2.0, throttle=1.0), ice)[-1]
    assert front_left > 1.5
    np.testing.assert_allclose(rear, 1.0, rtol=0.02)


def test_the_electric_car_neither_creeps_nor_rolls_back_at_the_released_pedal() -> None:
    assert np.abs(drive(ELECTRIC, 0.0, 3.0).motion).max() < 1e-6
    assert drive(ELECTRIC, 60.0, 30.0).speed_mps.min() > -0.01


def test_the_rear_brake_pressure_is_reduced_above_its_knee() -> None:
    record = car_record(CAR)
    assert steady_pressures_mpa(37.5, record) == pytest.approx((1.5, 1.5))
    assert steady_pressures_mpa(150.0, record) == pytest.approx((6.0, 1.5 + 0.3 * 4.5))
    assert steady_pressures_mpa(-1.0, record) == (0.0, 0.0)


def test_pressure_follows_the_pedal_with_its_lag() -> None:
    run = drive(CAR, 90.0, 0.5, brake_n=100.0)
    expected = 4.0 * (1.0 - np.exp(-run.time_s / 0.06))
    np.testing.assert_allclose(run.column("brake_mpa"), expected, atol=1e-9)


@pytest.mark.parametrize("friction", [0.2, 0.85])
def test_the_anti_lock_system_keeps_the_wheels_turning_and_shortens_the_way(
    friction: float,
) -> None:
    road = with_road_friction(ELECTRIC, friction)
    helped, locked = (
        drive(car, 80.0, 20.0 if friction < 0.3 else 8.0, brake_n=400.0)
        for car in (road, road._replace(anti_lock=NO_ANTI_LOCK))
    )
    fast = (helped.speed_mps > 5.0) & (helped.time_s > 0.5)
    assert rim_share(helped, road)[fast].min() > 0.6
    assert rim_share(locked, road)[20].min() < 0.05
    assert helped.x_m[-1] < locked.x_m[-1]
    assert np.abs(helped.motion[-20:]).max() < 0.01


@pytest.mark.parametrize("friction", [0.2])
def test_traction_control_limits_the_slip_of_the_driven_wheels(friction: float) -> None:
    road = with_road_friction(ELECTRIC, friction)
    without = road._replace(traction_control=NO_TRACTION_CONTROL)
    helped, spinning = (drive(car, 15.0, 4.0, 1.0) for car in (road, without))
    assert rim_share(helped, road)[40:].max() < 1.3
    assert rim_share(spinning, road)[40:].max() > 2.0
    assert helped.speed_mps[-1] > 0.9 * spinning.speed_mps[-1]


@pytest.mark.parametrize(
    ("friction", "v0_mps", "throttle", "steer_rad", "least", "most"),
    [
        (0.85, 0.0, 0.3, 8.0, 0.0, 0.05),
        (0.85, 0.0, 1.0, 8.0, 0.5, 1.0),
        (0.2, 4.0, 0.5, 0.0, 0.9, 1.0),
        (0.2, 4.0, 0.5, 8.0, 0.9, 1.0),
    ],
)
def test_traction_control_acts_on_spinning_wheels_and_not_in_a_tight_turn(
    friction: float, v0_mps: float, throttle: float, steer_rad: float, least: float, most: float
) -> None:
    """Radius 7 m: wheels that roll differ from the car by 10 %; those that spin by more."""
    car, control = with_road_friction(ELECTRIC, friction), ControlInput(throttle, 0.0, steer_rad)
    state, record, cuts = settle(v0_mps, car), car_record(car), []
    for _ in range(240):
        advance(state, control, record, 25, 0.001, np.empty((25, 3)))
        cuts.append(state[AT.torque_cut])
    assert least <= max(cuts) <= most
    assert state[AT.vx_mps] > 2.0


@pytest.fixture
def fresh_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An installation whose car is not compiled yet; its folder for the car."""
    monkeypatch.setattr(library, "BUILT", tmp_path / "built")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    library.car_library.cache_clear()
    yield tmp_path / "built"
    library.car_library.cache_clear()


def test_the_car_is_compiled_at_the_first_use(fresh_library: Path) -> None:
    assert np.isfinite(library.settle(10.0, default_car())).all()
    assert [file.name for file in fresh_library.iterdir()] == [compiler.car_library_name()]


def test_a_read_only_installation_compiles_into_the_users_cache(
    fresh_library: Path, tmp_path: Path
) -> None:
    fresh_library.write_text("a file, where a folder is expected")
    assert np.isfinite(library.settle(10.0, default_car())).all()
    assert (tmp_path / "cache" / "rt-controller" / "car" / compiler.car_library_name()).exists()


@pytest.mark.parametrize(
    ("cc", "words"),
    [
        ("no-such-compiler --fast", "CC=no-such-compiler, which is no program"),
        ("false", "expected a C99 compiler with the headers of the C library"),
    ],
)
def test_without_a_compiler_the_message_says_what_to_install(
    fresh_library: Path, monkeypatch: pytest.MonkeyPatch, cc: str, words: str
) -> None:
    monkeypatch.setenv("CC", cc)
    with pytest.raises(MissingExtraError, match="apt-get install") as refusal:
        library.settle(10.0, default_car())
    assert words in str(refusal.value)
    assert not list(fresh_library.glob("*"))


@pytest.mark.parametrize(
    "state", [np.zeros(50, dtype=np.float32), np.zeros((50, 2))[:, 0], [0.0] * 50]
)
def test_other_arrays_are_refused_before_the_call(state: object) -> None:
    """A wrong one would be memory that is not ours."""
    with pytest.raises(ctypes.ArgumentError):
        library.car_library().car_settle(10.0, np.zeros(434), state)


def test_the_car_compiles_without_a_warning_and_not_with_inexact_arithmetic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = shlex.join(find_compiler())
    monkeypatch.setenv("CC", f"{found} -Wall -Wextra -Wpedantic -Wconversion -Werror")
    compile_car(tmp_path / "strict")
    monkeypatch.setenv("CC", f"{found} -ffast-math")
    with pytest.raises(CompileError, match="IEEE"):
        compile_car(tmp_path / "fast")


def test_the_governor_keeps_idle_speed_and_the_closed_throttle_brakes() -> None:
    idle = drive(CAR, 0.0, 2.0, brake_n=60.0)
    assert idle.column("engine_rpm")[-1] == pytest.approx(CAR.engine.idle_speed_rpm, rel=0.05)
    coasting = drive(CAR, 22.0 * 3.6, 3.0)
    assert coasting.column("engine_nm")[-1] < -20.0
    deceleration_mps2 = (coasting.speed_mps[20] - coasting.speed_mps[-1]) / 2.5
    air_n = 0.5 * CAR.aero.air_density_kgpm3 * CAR.aero.area_m2 * CAR.aero.drag * 22.0**2
    air_and_road_mps2 = air_n / CAR.body.mass_kg + 0.006 * GRAVITY_MPS2
    assert 1.1 * air_and_road_mps2 < deceleration_mps2 < 0.08 * GRAVITY_MPS2


def test_without_anti_lock_no_wheel_locks_with_150_n_and_all_lock_on_ice() -> None:
    car = CAR._replace(anti_lock=NO_ANTI_LOCK)
    run = drive(car, 100.0, 5.0, brake_n=150.0)
    assert rim_share(run, car)[run.speed_mps > 3.0].min() > 0.8
    run = drive(with_road_friction(car, 0.3), 60.0, 2.0, brake_n=400.0)
    assert rim_share(run, car)[40].max() < 0.05
