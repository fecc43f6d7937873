"""Engine map, electric motor, anti-lock and traction control, and what they do to the car."""

from math import pi

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.plant.drive import engine
from sim_bridge.plant.parameters import Parameters, default_car, load_parameters, with_road_friction
from sim_bridge.plant.parts import NO_ANTI_LOCK, NO_TRACTION_CONTROL
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay

CAR = default_car()

FRONT_DRIVE = load_parameters("c_class_125kw_fwd")
ELECTRIC = load_parameters("c_class_150kw_bev")
PERIOD_S = 0.025


def drive(
    car: Parameters, v0_kmh: float, seconds: float, throttle: Array | float = 0.0,
    brake_n: float = 0.0,
) -> Run:  # fmt: skip
    inputs = input_table(round(seconds / PERIOD_S), throttle, brake_n)
    return replay(car, v0_kmh / 3.6, inputs, PERIOD_S)


def reached_s(run: Run, kmh: float) -> float:
    return float(run.time_s[np.argmax(run.speed_mps >= kmh / 3.6)])


def rim_share(run: Run, car: Parameters) -> Array:
    """Speed of each rim over that of the car."""
    return run.spins_radps * car.tyre.rolling_radius_m / run.speed_mps[:, None]


def test_the_map_gives_its_own_points_and_lies_between_them() -> None:
    part = CAR.engine
    for column, speed_rpm in enumerate(part.map_speeds_rpm):
        for row, throttle in enumerate(part.map_throttles):
            found = engine.map_column(speed_rpm, part.map_speeds_rpm)
            torque = engine.map_nm(*found, throttle, part.map_throttles, part.map_nm)
            assert torque == pytest.approx(part.map_nm[row][column])
    halfway = engine.map_column(1125.0, part.map_speeds_rpm)
    torque = engine.map_nm(*halfway, 0.125, part.map_throttles, part.map_nm)
    corners = [part.map_nm[row][column] for row in (1, 2) for column in (0, 1)]
    assert torque == pytest.approx(np.mean(corners))


def test_the_front_drive_car_has_the_part_throttle_torque_of_its_reference() -> None:
    torque = engine.torque_nm(2390.0 * pi / 30.0, 0.2, 1.0, FRONT_DRIVE.engine)
    assert torque == pytest.approx(140.0, rel=0.03)
    assert cruising_throttle(FRONT_DRIVE, 120.0 / 3.6) == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize("pedal", ["brake held", "late step", "ramp"])
def test_the_launch_at_throttle_0_2_takes_the_time_of_the_reference(pedal: str) -> None:
    """20 km/h after 4.3 s and 60 km/h after 10.8 s.

    The pedal is pressed after 1.6 s, with or without the brake until then, or in a ramp of 3 s.
    """
    time_s = PERIOD_S * np.arange(600)
    throttle = np.where(time_s < 1.6, 0.0, 0.2)
    brake_n = np.where((time_s < 1.6) & (pedal == "brake held"), 60.0, 0.0)
    if pedal == "ramp":
        throttle = np.minimum(0.2, 0.2 / 3.0 * time_s)
    run = replay(FRONT_DRIVE, 0.0, input_table(600, throttle, brake_n), PERIOD_S)
    assert reached_s(run, 20.0) == pytest.approx(4.3, rel=0.1)
    assert reached_s(run, 60.0) == pytest.approx(10.8, rel=0.1)


def test_the_engine_torque_is_an_output() -> None:
    run = drive(FRONT_DRIVE, 120.0, 1.0, 0.15)
    assert run.column("engine_nm")[-1] == pytest.approx(77.0, rel=0.1)


def test_the_electric_car_accelerates_in_one_gear() -> None:
    run = drive(ELECTRIC, 0.0, 14.0, 1.0)
    assert 7.0 < reached_s(run, 100.0) < 10.0
    assert set(run.column("gear")) == {1.0}
    assert np.all(np.diff(run.speed_mps[20:]) > 0.0)


def test_the_electric_car_neither_creeps_nor_rolls_back_at_the_released_pedal() -> None:
    assert np.abs(drive(ELECTRIC, 0.0, 3.0).motion).max() < 1e-6
    stopping = drive(ELECTRIC, 60.0, 30.0)
    assert stopping.speed_mps.min() > -0.01


def test_the_electric_car_regenerates_at_the_released_pedal() -> None:
    run = drive(ELECTRIC, 80.0, 4.0)
    assert -2.5 < run.column("ax_mps2")[80] < -1.2
    power_w = run.column("engine_nm") * run.column("engine_rpm") * pi / 30.0
    assert -61e3 < power_w.min() < -20e3
    assert drive(CAR, 80.0, 4.0).column("ax_mps2")[80] > -1.2


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.85])
def test_the_anti_lock_system_keeps_the_wheels_turning_and_shortens_the_way(
    friction: float,
) -> None:
    road = with_road_friction(ELECTRIC, friction)
    without = road._replace(anti_lock=NO_ANTI_LOCK)
    helped = drive(road, 80.0, 20.0 if friction < 0.3 else 8.0, brake_n=400.0)
    locked = drive(without, 80.0, 20.0 if friction < 0.3 else 8.0, brake_n=400.0)
    fast = helped.speed_mps > 5.0
    fast[: round(0.5 / PERIOD_S)] = False
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
    assert helped.speed_mps[-1] > 0.97 * spinning.speed_mps[-1]


@pytest.mark.parametrize("throttle", [0.3, 1.0])
def test_traction_control_leaves_the_speeds_of_a_tight_turn_alone(throttle: float) -> None:
    """Dry road, radius 7 m: wheels that roll differ from the car by 10 %; those that spin more."""
    cuts, speeds = cut_and_speed(ELECTRIC, 0.0, throttle)
    if throttle < 0.5:
        assert cuts.max() < 0.05
        assert speeds[-1] > 3.0
    else:
        assert cuts.max() > 0.5
        assert speeds[-1] > 6.0


@pytest.mark.parametrize("steer_rad", [0.0, 8.0])
def test_traction_control_acts_on_ice_straight_ahead_and_in_a_turn(steer_rad: float) -> None:
    cuts, _ = cut_and_speed(with_road_friction(ELECTRIC, 0.2), 4.0, 0.5, steer_rad)
    assert cuts.max() > 0.9


def cut_and_speed(
    car: Parameters, v0_mps: float, throttle: float, steer_rad: float = 8.0
) -> tuple[Array, Array]:
    """(240,) share of torque taken away and speed after each of 240 periods."""
    own = OwnCar(car)
    own.reset(v0_mps)
    speeds_mps, cuts = [], []
    for _ in range(240):
        motion = own.step(ControlInput(throttle, 0.0, steer_rad), PERIOD_S)
        speeds_mps.append(motion[-1, 0])
        cuts.append(own._state[AT.torque_cut])
    return np.array(cuts), np.array(speeds_mps)


def test_a_car_with_one_gear_is_in_its_first_gear_at_every_speed() -> None:
    own = OwnCar(ELECTRIC)
    for v0_mps in (0.0, 20.0, 60.0):
        own.reset(v0_mps)
        assert own.outputs().gear == 1.0
        own.step(ControlInput(0.3, 0.0, 0.0), PERIOD_S)
        assert own.outputs().gear == 1.0


def test_cars_without_these_parts_have_no_such_states() -> None:
    assert CAR.anti_lock == NO_ANTI_LOCK
    assert CAR.traction_control == NO_TRACTION_CONTROL
    run = drive(with_road_friction(CAR, 0.3), 60.0, 2.0, brake_n=400.0)
    assert rim_share(run, CAR)[40].max() < 0.05
