"""Engine, motor, converter, gearbox, brakes and their helpers, by what they do to the car."""

from math import pi

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import advance, settle, steady_pressures_mpa
from sim_bridge.plant.parameters import Parameters, default_car, load_parameters, with_road_friction
from sim_bridge.plant.parts import NO_ANTI_LOCK, NO_TRACTION_CONTROL
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import reversals

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


def reached_s(run: Run, kmh: float) -> float:
    return float(run.time_s[np.argmax(run.speed_mps >= kmh / 3.6)])


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


def test_the_governor_keeps_idle_speed_and_the_closed_throttle_brakes() -> None:
    idle = drive(CAR, 0.0, 2.0, brake_n=60.0)
    assert idle.column("engine_rpm")[-1] == pytest.approx(CAR.engine.idle_speed_rpm, rel=0.05)
    coasting = drive(CAR, 22.0 * 3.6, 3.0)
    assert coasting.column("engine_nm")[-1] < -20.0
    deceleration_mps2 = (coasting.speed_mps[20] - coasting.speed_mps[-1]) / 2.5
    air_n = 0.5 * CAR.aero.air_density_kgpm3 * CAR.aero.area_m2 * CAR.aero.drag * 22.0**2
    air_and_road_mps2 = air_n / CAR.body.mass_kg + 0.006 * GRAVITY_MPS2
    assert 1.1 * air_and_road_mps2 < deceleration_mps2 < 0.08 * GRAVITY_MPS2


@pytest.mark.parametrize("throttle", [0.05, 0.1, 0.2, 0.35, 0.6, 1.0])
@pytest.mark.parametrize("v0_mps", [5.0, 15.0, 35.0])
def test_the_gearbox_does_not_hunt_at_a_constant_pedal(throttle: float, v0_mps: float) -> None:
    """The shift direction changes at most once, and the last 10 s have one gear."""
    gear = drive(CAR, v0_mps * 3.6, 120.0, throttle).column("gear")
    assert reversals(gear) <= 1
    assert np.ptp(gear[-400:]) == 0.0


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


def test_the_twist_of_the_shafts_settles_at_the_steady_torque() -> None:
    """After a throttle step at 40 km/h; the axle drives lose some of it."""
    run = drive(CAR, 40.0, 4.0, np.where(np.arange(160) < 40, 0.1, 0.5))
    twist = run.column("wind_up_rad")
    wheels_nm = CAR.driveline.shaft_stiffness_nmprad * CAR.driveline.final_efficiency * twist[-1]
    body_nm = CAR.body.mass_kg * run.column("ax_mps2")[-1] * CAR.tyre.rolling_radius_m
    assert twist[-1] > 2.0 * twist[39]
    assert 0.8 * wheels_nm < body_nm < wheels_nm
    assert np.ptp(twist[-10:]) < 0.02 * twist[-1]


def test_the_front_drive_car_drives_its_front_wheels_only() -> None:
    ice = with_road_friction(FRONT_DRIVE, 0.2)._replace(traction_control=NO_TRACTION_CONTROL)
    front_left, _, *rear = rim_share(drive(ice, 7.2, 2.0, throttle=1.0), ice)[-1]
    assert front_left > 1.5
    np.testing.assert_allclose(rear, 1.0, rtol=0.02)


def test_the_front_drive_car_has_the_part_throttle_torque_of_its_reference() -> None:
    assert cruising_throttle(FRONT_DRIVE, 120.0 / 3.6) == pytest.approx(0.15, abs=0.01)
    run = drive(FRONT_DRIVE, 120.0, 1.0, 0.15)
    assert run.column("engine_nm")[-1] == pytest.approx(77.0, rel=0.1)


@pytest.mark.parametrize(("kmh", "seconds"), [(20.0, 4.30), (40.0, 6.83), (60.0, 10.83)])
def test_the_launch_takes_the_time_of_the_reference(kmh: float, seconds: float) -> None:
    """The pedal is pressed to 0.2 in a ramp of 5 s."""
    throttle = np.minimum(0.2, 0.2 / 5.0 * PERIOD_S * np.arange(600))
    run = drive(FRONT_DRIVE, 0.0, 15.0, throttle)
    assert reached_s(run, kmh) == pytest.approx(seconds, rel=0.1)


def test_the_electric_car_accelerates_in_one_gear() -> None:
    run = drive(ELECTRIC, 0.0, 14.0, 1.0)
    assert reached_s(run, 100.0) == pytest.approx(7.3, rel=0.1)
    assert set(run.column("gear")) == {1.0}
    assert drive(ELECTRIC, 216.0, 0.1, 0.3).column("gear").max() == 1.0
    assert np.all(np.diff(run.speed_mps[20:]) > 0.0)


def test_the_electric_car_neither_creeps_nor_rolls_back_at_the_released_pedal() -> None:
    assert np.abs(drive(ELECTRIC, 0.0, 3.0).motion).max() < 1e-6
    assert drive(ELECTRIC, 60.0, 30.0).speed_mps.min() > -0.01


def test_the_electric_car_regenerates_at_the_released_pedal() -> None:
    run = drive(ELECTRIC, 80.0, 4.0)
    assert run.column("ax_mps2")[80] / GRAVITY_MPS2 == pytest.approx(-0.08, abs=0.02)
    power_w = run.column("engine_nm") * run.column("engine_rpm") * pi / 30.0
    assert -31e3 < power_w.min() < -15e3
    assert drive(CAR, 80.0, 4.0).column("ax_mps2")[80] > -0.6


def test_the_rear_brake_pressure_is_reduced_above_its_knee() -> None:
    record = car_record(CAR)
    assert steady_pressures_mpa(37.5, record) == pytest.approx((1.5, 1.5))
    assert steady_pressures_mpa(150.0, record) == pytest.approx((6.0, 1.5 + 0.3 * 4.5))
    assert steady_pressures_mpa(-1.0, record) == (0.0, 0.0)


def test_pressure_follows_the_pedal_with_its_lag() -> None:
    run = drive(CAR, 90.0, 0.5, brake_n=100.0)
    expected = 4.0 * (1.0 - np.exp(-run.time_s / 0.06))
    np.testing.assert_allclose(run.column("brake_mpa"), expected, atol=1e-9)


def test_without_anti_lock_no_wheel_locks_with_150_n_and_all_lock_on_ice() -> None:
    car = CAR._replace(anti_lock=NO_ANTI_LOCK)
    run = drive(car, 100.0, 5.0, brake_n=150.0)
    assert rim_share(run, car)[run.speed_mps > 3.0].min() > 0.8
    run = drive(with_road_friction(car, 0.3), 60.0, 2.0, brake_n=400.0)
    assert rim_share(run, car)[40].max() < 0.05


@pytest.mark.parametrize("car", [CAR, FRONT_DRIVE, ELECTRIC])
@pytest.mark.parametrize("brake_n", [0.0, 30.0, 55.0, 75.0, 95.0])
def test_braking_in_a_turn_neither_tightens_it_much_nor_spins_the_car(
    car: Parameters, brake_n: float
) -> None:
    """Radius 100 m at 80 km/h, steering held, pedal released: up to 0.45 g of braking."""
    throttle = cruising_throttle(car, 80.0 / 3.6)
    time_s = PERIOD_S * np.arange(400)
    brakes = time_s >= 6.0
    inputs = input_table(
        400, np.where(brakes, 0.0, 1.6 * throttle), np.where(brakes, brake_n, 0.0),
        np.minimum(1.0, time_s / 2.0) * 0.73,
    )  # fmt: skip
    run = replay(car, 80.0 / 3.6, inputs, PERIOD_S)
    before, after = (np.interp(at_s, run.time_s, run.yaw_rate_degps) for at_s in (6.0, 7.0))
    assert run.column("ay_mps2")[239] == pytest.approx(4.9, abs=0.6)
    assert 0.85 < after / before < 1.25
    assert np.abs(np.degrees(run.column("sideslip_rad"))).max() < 4.0


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.85])
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


@pytest.mark.parametrize("friction", [0.2, 0.5])
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
