"""Behaviour of the default car that the acceptance table does not measure."""

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    load_parameters,
    with_road_friction,
)
from sim_bridge.validation.run import Observation, Run, input_table, replay, run_driver
from sim_bridge.validation.signal_metrics import reversals

CAR = default_car()
PERIOD_S = 0.025


def drive(
    v0_mps: float,
    seconds: float,
    throttle: Array | float = 0.0,
    brake_n: float = 0.0,
    car: Parameters = CAR,
) -> Run:
    """A drive straight ahead."""
    inputs = input_table(round(seconds / PERIOD_S), throttle, brake_n)
    return replay(car, v0_mps, inputs, PERIOD_S)


def rims_mps(run: Run, car: Parameters = CAR) -> Array:
    return run.spins_radps * car.tyre.rolling_radius_m


@pytest.fixture(scope="module")
def full_throttle() -> Run:
    return drive(0.0, 20.0, throttle=1.0)


def test_gears_go_up_one_by_one_at_full_throttle(full_throttle: Run) -> None:
    gear = full_throttle.column("gear")
    assert set(np.diff(gear)) == {0.0, 1.0}
    assert gear[-1] >= 4.0
    assert full_throttle.column("engine_rpm").max() < 6000.0


@pytest.mark.parametrize("throttle", [0.05, 0.1, 0.2, 0.35, 0.6, 1.0])
@pytest.mark.parametrize("v0_mps", [5.0, 15.0, 35.0])
def test_the_gearbox_does_not_hunt_at_a_constant_pedal(throttle: float, v0_mps: float) -> None:
    """The shift direction changes at most once, and the last 10 s have one gear."""
    gear = drive(v0_mps, 60.0, throttle).column("gear")
    assert reversals(gear) <= 1
    assert np.ptp(gear[-400:]) == 0.0


def test_the_closed_throttle_brakes_with_the_engine() -> None:
    speed_mps = drive(22.0, 3.0).speed_mps
    deceleration_mps2 = (speed_mps[20] - speed_mps[-1]) / 2.5
    air_n = 0.5 * CAR.aero.air_density_kgpm3 * CAR.aero.area_m2 * CAR.aero.drag * 22.0**2
    air_and_road_mps2 = air_n / CAR.body.mass_kg + 0.006 * GRAVITY_MPS2
    assert 1.1 * air_and_road_mps2 < deceleration_mps2 < 0.08 * GRAVITY_MPS2


def test_no_wheel_locks_with_150_n() -> None:
    run = drive(100.0 / 3.6, 5.0, brake_n=150.0)
    rolling = run.speed_mps > 3.0
    assert np.all(rims_mps(run)[rolling] > 0.8 * run.speed_mps[rolling, None])


def test_pressure_follows_the_pedal_with_its_lag() -> None:
    run = drive(25.0, 0.5, brake_n=100.0)
    expected = 4.0 * (1.0 - np.exp(-run.time_s / 0.06))
    np.testing.assert_allclose(run.column("brake_mpa"), expected, atol=1e-9)


def test_the_acceleration_dips_in_an_up_shift_and_does_not_oscillate(full_throttle: Run) -> None:
    """During a shift it falls below that of the next gear and stays positive."""
    ax = full_throttle.column("ax_mps2")
    for k in np.flatnonzero(np.diff(full_throttle.column("gear"))):
        during = ax[k : k + 16]
        assert during.min() < ax[k + 20] < ax[k - 1]
        assert during.min() > 0.0
        assert during.max() < 1.3 * ax[k - 1]
    assert np.all(np.diff(full_throttle.speed_mps[40:]) > 0.0)


def test_the_twist_of_the_shafts_settles_at_the_steady_torque() -> None:
    """After a throttle step at 40 km/h."""
    throttle = np.where(np.arange(160) < 40, 0.1, 0.5)
    run = drive(40.0 / 3.6, 4.0, throttle)
    twist = run.column("wind_up_rad")
    wheels_nm = CAR.driveline.shaft_stiffness_nmprad * CAR.driveline.final_efficiency * twist[-1]
    body_nm = CAR.body.mass_kg * run.column("ax_mps2")[-1] * CAR.tyre.rolling_radius_m
    assert twist[-1] > 2.0 * twist[39]
    assert 0.8 * wheels_nm < body_nm < wheels_nm
    assert np.ptp(twist[-10:]) < 0.02 * twist[-1]


def test_the_front_drive_car_drives_its_front_wheels_only() -> None:
    ice = with_road_friction(load_parameters("c_class_125kw_fwd"), 0.2)
    run = drive(2.0, 2.0, throttle=1.0, car=ice)
    front_left, _, *rear = rims_mps(run, ice)[-1]
    assert front_left > 1.5 * run.speed_mps[-1]
    np.testing.assert_allclose(rear, run.speed_mps[-1], rtol=0.02)


def test_the_car_dives_under_braking_and_squats_under_drive() -> None:
    braked, driven = drive(25.0, 1.5, brake_n=100.0), drive(10.0, 2.0, throttle=1.0)
    assert 0.5 < np.degrees(braked.column("pitch_rad")[-1]) < 2.0
    assert np.degrees(driven.column("pitch_rad")[-1]) < -0.3
    assert braked.column("travel_front_left_m")[-1] > 0.01
    assert braked.column("travel_rear_left_m")[-1] < -0.01


def test_the_car_understeers_and_does_not_spin_beyond_the_limit() -> None:
    """At 100 km/h with an increasing steering angle: it still turns less than it is steered."""
    v0_mps = 100.0 / 3.6

    def driver(now: Observation) -> ControlInput:
        throttle = float(np.clip(0.3 + 0.5 * (v0_mps - now.vx_mps), 0.0, 1.0))
        return ControlInput(throttle, 0.0, float(np.radians(10.0 * now.time_s)))

    run = run_driver(CAR, v0_mps, driver, 12.0, PERIOD_S)
    body = CAR.body
    front_rad = (run.motion[-1, 1] + body.front_axle_m * run.motion[-1, 2]) / run.speed_mps[-1]
    rear_rad = (run.motion[-1, 1] - body.rear_axle_m * run.motion[-1, 2]) / run.speed_mps[-1]
    front_slip = abs(front_rad - run.column("road_wheel_rad")[-1])
    assert 0.7 < run.lateral_g.max() < 0.85
    assert front_slip > 1.5 * abs(rear_rad)
    assert abs(run.sideslip_deg[-1]) < 5.0
