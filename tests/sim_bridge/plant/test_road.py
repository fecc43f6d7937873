"""The car on a road: stepped by the control period, on grades, banked roads and in wind."""

from math import atan, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wandering_inputs import wandering_inputs

from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge import frenet
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import Parameters, default_car, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.validation.run import cruising_throttle, input_table, replay

CAR = default_car()

DRY = RoadParameters(0.85, 0.85)
CURVATURE_PER_M = 0.002


def on(**fields: float) -> Parameters:
    return with_road(CAR, DRY._replace(**fields))


@settings(max_examples=12, deadline=None, derandomize=True)
@given(grade=st.floats(-0.25, 0.25), bank=st.floats(-0.15, 0.15))
def test_the_brake_holds_the_car_on_a_slope(grade: float, bank: float) -> None:
    """No creep and no chatter: after the first second nothing moves for ten seconds."""
    run = replay(on(grade_rad=grade, bank_rad=bank), 0.0, input_table(440, brake_n=100.0), 0.025)
    assert np.abs(run.motion[40:]).max() < 1e-4
    assert np.ptp(run.x_m[40:]) < 1e-4
    assert np.abs(run.motion[-200:]).max() < 1e-6


def test_a_grade_needs_throttle_and_shifts_load_to_the_rear() -> None:
    slope = 0.06
    assert cruising_throttle(on(grade_rad=slope), 22.0) > cruising_throttle(on(), 22.0) + 0.03
    standing, flat = (
        replay(on(grade_rad=each), 0.0, input_table(40, brake_n=100.0), 0.025)
        for each in (slope, 0.0)
    )
    height_m, wheelbase_m = 0.507, 2.91
    weight_n = CAR.body.mass_kg * GRAVITY_MPS2
    shifted_n = weight_n * np.sin(slope) * height_m / wheelbase_m
    lighter_n = (1.0 - np.cos(slope)) * flat.loads_n[-1, 2:].sum()
    change_n = standing.loads_n[-1] - flat.loads_n[-1]
    assert change_n[2] + change_n[3] == pytest.approx(shifted_n - lighter_n, rel=0.02)
    on_slope_n = flat.loads_n[-1].sum() * np.cos(slope)
    assert standing.loads_n[-1].sum() == pytest.approx(on_slope_n, rel=1e-4)


def test_in_a_banked_bend_the_accelerometer_reads_less() -> None:
    """A left bend whose outer, right side is higher: a bank of minus the lateral acceleration."""
    steer_rad = radians(20.0)
    flat = replay(on(), 22.0, input_table(200, 0.13, steer_rad=steer_rad), 0.025)
    bank_rad = -atan(0.5 * flat.column("ay_mps2")[-1] / GRAVITY_MPS2)
    banked = replay(on(bank_rad=bank_rad), 22.0, input_table(200, 0.13, steer_rad=steer_rad), 0.025)
    read = banked.column("accelerometer_left_mps2")[-1]
    assert read < 0.7 * flat.column("accelerometer_left_mps2")[-1]
    assert abs(banked.roll_deg[-1]) < 0.7 * abs(flat.roll_deg[-1])


def test_a_reset_returns_to_the_road_of_construction() -> None:
    car = OwnCar(CAR)
    first, first_outputs = car.reset(20.0), car.outputs()
    car.set_road(RoadAt(0.0, 0.0, 0.2, 0.3, 0.1, 0.1, 5.0, 5.0))
    car.step(ControlInput(0.5, 0.0, 0.1), 0.025)
    np.testing.assert_array_equal(car.reset(20.0), first)
    assert car.outputs() == first_outputs
    assert car.parameters == CAR


def test_a_car_stepped_by_periods_equals_the_simulated_episode() -> None:
    """To the last bit."""
    inputs = wandering_inputs(120)
    car = Car(OwnCar(CAR), 22.0)
    car.reset(22.0, ey_m=-0.7, epsi_rad=0.03)
    states = [car.advance(control, CURVATURE_PER_M) for control in inputs]

    motion, _ = simulate(settle(22.0, CAR), np.array(inputs), CAR)
    poses = frenet.integrate_poses(motion, CURVATURE_PER_M, -0.7, 0.03, STEPS_PER_PERIOD, STEP_S)
    seen = np.array(states)
    np.testing.assert_array_equal(seen[:, :3], motion[STEPS_PER_PERIOD::STEPS_PER_PERIOD])
    np.testing.assert_array_equal(seen[:, 3], np.diff(poses[:, frenet.S]))
    np.testing.assert_array_equal(seen[:, 4:], poses[1:, 1:])


def test_a_road_that_changes_by_the_period_acts_as_behind_the_bridge() -> None:
    """To the last bit."""
    inputs = wandering_inputs(80)
    k = np.arange(80)
    flat = np.tile(np.array(CAR.road), (80, 1))
    roads = flat + 0.02 * np.sin(0.1 * k[:, None] + np.arange(6))
    roads[40:, 0] = 0.4
    at_start = CAR._replace(road=RoadParameters(*roads[0].tolist()))
    car = OwnCar(at_start)
    stepped = [car.reset(22.0)]
    for control, row in zip(inputs, roads.tolist(), strict=True):
        car.set_road(RoadAt(0.0, 0.0, *row))
        stepped.append(car.step(control, PERIOD_S)[-1].copy())
    motion, _ = simulate(settle(22.0, at_start), np.array(inputs), at_start, roads=roads)
    np.testing.assert_array_equal(np.array(stepped), motion[::STEPS_PER_PERIOD])
    on_flat, _ = simulate(settle(22.0, at_start), np.array(inputs), at_start)
    assert np.abs(motion - on_flat).max() > 0.05
