"""How the car drives off, shifts and stops, against the car it stands for."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_bridge.plant.integrate import settle, simulate
from sim_bridge.plant.monitor import Monitor
from sim_bridge.plant.parameters import C_CLASS_150KW_AWD as CAR
from sim_bridge.plant.parameters import GRAVITY_MPS2, load_parameters, with_road_friction

Array = NDArray[np.float64]


def held(seconds: float, throttle: float = 0.0, brake_n: float = 0.0) -> Array:
    return np.tile((throttle, brake_n, 0.0), (round(seconds / 0.025), 1))


def column(monitor: Array, name: str) -> Array:
    return monitor[:, Monitor._fields.index(name)]


@pytest.fixture(scope="module")
def full_throttle() -> tuple[Array, Array]:
    return simulate(settle(0.0, CAR), held(20.0, throttle=1.0), CAR, 25, 0.001)


def test_hundred_is_reached_in_the_time_of_its_class(full_throttle: tuple[Array, Array]) -> None:
    """8 to 9 s for the car it stands for."""
    motion, _ = full_throttle
    seconds = np.argmax(motion[:, 0] >= 100.0 / 3.6) * 0.001
    assert 8.0 < seconds < 9.0


def test_gears_go_up_one_by_one_at_full_throttle(full_throttle: tuple[Array, Array]) -> None:
    _, monitor = full_throttle
    steps = np.diff(column(monitor, "gear"))
    assert set(steps) == {0.0, 1.0}
    assert column(monitor, "gear")[-1] >= 4.0
    assert column(monitor, "engine_rpm").max() < 6000.0


@pytest.mark.parametrize("throttle", [0.05, 0.1, 0.2, 0.35, 0.6, 1.0])
@pytest.mark.parametrize("v0_mps", [5.0, 15.0, 35.0])
def test_a_steady_pedal_does_not_make_the_gearbox_hunt(throttle: float, v0_mps: float) -> None:
    """Shifts go one way, or turn once while the speed does, and end in one gear."""
    start = settle(v0_mps, CAR)
    _, monitor = simulate(start, held(60.0, throttle=throttle), CAR, 25, 0.001)
    gear = column(monitor, "gear")
    shifts = np.diff(gear)[np.diff(gear) != 0.0]
    assert np.count_nonzero(np.diff(np.sign(shifts))) <= 1
    assert np.ptp(gear[-400:]) == 0.0


def test_lifting_off_in_gear_brakes_with_the_engine() -> None:
    run, _ = simulate(settle(22.0, CAR), held(3.0), CAR, 25, 0.001)
    in_gear = (run[500, 0] - run[-1, 0]) / 2.5
    air_and_road = (
        0.5 * CAR.aero.air_density_kgpm3 * CAR.aero.area_m2 * CAR.aero.drag * 22.0**2
    ) / CAR.body.mass_kg + 0.006 * GRAVITY_MPS2
    assert 1.1 * air_and_road < in_gear < 0.08 * GRAVITY_MPS2


def test_a_full_pedal_stops_with_eight_tenths_g() -> None:
    motion, monitor = simulate(settle(100.0 / 3.6, CAR), held(5.0, brake_n=150.0), CAR, 25, 0.001)
    between = (motion[:, 0] < 80.0 / 3.6) & (motion[:, 0] > 10.0 / 3.6)
    deceleration = 70.0 / 3.6 / (between.sum() * 0.001)
    assert deceleration / GRAVITY_MPS2 == pytest.approx(0.8, rel=0.05)
    rolling = motion[::25, 0] > 3.0
    assert np.all(monitor[rolling, -4:] > 0.8 * motion[::25, :1][rolling] / 0.325)


def test_pressure_follows_the_pedal_with_its_lag() -> None:
    _, monitor = simulate(settle(25.0, CAR), held(0.5, brake_n=100.0), CAR, 25, 0.001)
    times = np.arange(len(monitor)) * 0.025
    expected = 4.0 * (1.0 - np.exp(-times / 0.06))
    np.testing.assert_allclose(column(monitor, "brake_mpa"), expected, atol=1e-9)


@pytest.mark.parametrize("brake_n", [50.0, 80.0, 110.0, 150.0])
@pytest.mark.parametrize("road", [0.2, 0.35, 0.5, 0.7])
def test_the_rear_wheels_never_lock_first(brake_n: float, road: float) -> None:
    car = with_road_friction(CAR, road)
    motion, monitor = simulate(settle(100.0 / 3.6, car), held(4.0, brake_n=brake_n), car, 25, 0.001)
    rolling = motion[::25, 0] > 5.0
    spin = monitor[rolling, -4:] * 0.325 / motion[::25, :1][rolling]
    locked = spin < 0.2
    first = [int(np.argmax(wheel)) if wheel.any() else 10_000 for wheel in locked.T]
    assert first[0] <= first[2]
    assert first[1] <= first[3]


def test_an_up_shift_is_felt_and_does_not_jolt(full_throttle: tuple[Array, Array]) -> None:
    """Through a shift the push dips towards the next gear's, without pulling back."""
    motion, monitor = full_throttle
    ax = column(monitor, "ax_mps2")
    for k in np.flatnonzero(np.diff(column(monitor, "gear"))):
        through = ax[k : k + 16]
        assert through.min() < ax[k + 20] < ax[k - 1]
        assert through.min() > 0.0
        assert through.max() < 1.3 * ax[k - 1]
    assert np.all(np.diff(motion[1000:, 0]) > 0.0)


def test_the_shafts_wind_up_with_the_torque_and_come_to_rest() -> None:
    """Tip-in at 40 km/h: the twist swings in and stays where the steady torque needs it."""
    inputs = held(4.0, throttle=0.1)
    inputs[40:, 0] = 0.5
    _, monitor = simulate(settle(40.0 / 3.6, CAR), inputs, CAR, 25, 0.001)
    twist = column(monitor, "wind_up_rad")
    wheels_nm = CAR.driveline.shaft_stiffness_nmprad * CAR.driveline.final_efficiency * twist[-1]
    body_nm = CAR.body.mass_kg * column(monitor, "ax_mps2")[-1] * CAR.tyre.rolling_radius_m
    assert twist[-1] > 2.0 * twist[39]
    assert 0.8 * wheels_nm < body_nm < wheels_nm
    assert np.ptp(twist[-10:]) < 0.02 * twist[-1]


def test_the_front_drive_car_drives_with_its_front_wheels_only() -> None:
    front = load_parameters("c_class_125kw_fwd")
    ice = with_road_friction(front, 0.2)
    motion, monitor = simulate(settle(2.0, ice), held(2.0, throttle=1.0), ice, 25, 0.001)
    spin_mps = monitor[-1, -4:] * front.tyre.rolling_radius_m
    assert spin_mps[0] > 1.5 * motion[-1, 0]
    np.testing.assert_allclose(spin_mps[2:], motion[-1, 0], rtol=0.02)


def test_brake_dives_and_drive_squats() -> None:
    _, braked = simulate(settle(25.0, CAR), held(1.5, brake_n=100.0), CAR, 25, 0.001)
    _, driven = simulate(settle(10.0, CAR), held(2.0, throttle=1.0), CAR, 25, 0.001)
    assert 0.5 < np.degrees(column(braked, "pitch_rad")[-1]) < 2.0
    assert np.degrees(column(driven, "pitch_rad")[-1]) < -0.3
    assert column(braked, "travel_front_left_m")[-1] > 0.01
    assert column(braked, "travel_rear_left_m")[-1] < -0.01
