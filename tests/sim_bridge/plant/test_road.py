"""Slopes and wind: the car on grades and banked roads, at rest and in motion."""

from math import atan, radians

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.plant.parameters import Parameters, default_car, load_parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.validation.run import cruising_throttle, input_table, replay

CAR = default_car()

DRY = RoadParameters(0.85, 0.85)
Pair = tuple[float, float]


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


def test_a_car_without_brake_rolls_down() -> None:
    down = replay(on(grade_rad=-0.08), 0.0, input_table(120), 0.025)
    flat = replay(on(), 0.0, input_table(120), 0.025)
    assert down.motion[-1, 0] > flat.motion[-1, 0] + 0.3


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


def test_a_bank_pulls_the_car_down_and_steering_up_the_bank_balances_it() -> None:
    """Left side higher: without steering the car turns right."""
    run = replay(on(bank_rad=0.04), 22.0, input_table(80, 0.12), 0.025)
    assert run.y_m[-1] < -0.2
    assert run.column("accelerometer_left_mps2")[-1] > run.column("ay_mps2")[-1]


def test_in_a_banked_bend_the_accelerometer_reads_less() -> None:
    """A left bend whose outer, right side is higher: a bank of minus the lateral acceleration."""
    steer_rad = radians(20.0)
    flat = replay(on(), 22.0, input_table(200, 0.13, steer_rad=steer_rad), 0.025)
    bank_rad = -atan(0.5 * flat.column("ay_mps2")[-1] / GRAVITY_MPS2)
    banked = replay(on(bank_rad=bank_rad), 22.0, input_table(200, 0.13, steer_rad=steer_rad), 0.025)
    read = banked.column("accelerometer_left_mps2")[-1]
    assert read < 0.7 * flat.column("accelerometer_left_mps2")[-1]
    assert abs(banked.roll_deg[-1]) < 0.7 * abs(flat.roll_deg[-1])


def test_cross_wind_pushes_the_car_away_and_turns_it_with_the_wind() -> None:
    run = replay(on(wind_left_mps=8.0), 30.0, input_table(60, 0.15), 0.025)
    mirrored = replay(on(wind_left_mps=-8.0), 30.0, input_table(60, 0.15), 0.025)
    assert run.y_m[-1] > 0.1
    assert run.motion[20, 2] > 0.0
    np.testing.assert_allclose(mirrored.motion * (1.0, -1.0, -1.0), run.motion, atol=1e-9)


def test_head_wind_costs_throttle() -> None:
    still, against = (cruising_throttle(on(wind_forward_mps=w), 30.0) for w in (0.0, -10.0))
    assert against > still + 0.02


def test_a_reset_returns_to_the_road_of_construction() -> None:
    car = OwnCar(CAR)
    first, first_outputs = car.reset(20.0), car.outputs()
    car.set_road(RoadAt(0.0, 0.0, 0.2, 0.3, 0.1, 0.1, 5.0, 5.0))
    car.step(ControlInput(0.5, 0.0, 0.1), 0.025)
    np.testing.assert_array_equal(car.reset(20.0), first)
    assert car.outputs() == first_outputs
    assert car.parameters == CAR


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    name=st.sampled_from(shipped_cars()),
    v0_kmh=st.floats(0.0, 200.0),
    slopes=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    wind=st.tuples(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0)),
    friction=st.floats(0.1, 1.2),
    seed=st.integers(0, 2**32 - 1),
)
def test_random_driving_on_any_road_stays_finite(
    name: str, v0_kmh: float, slopes: Pair, wind: Pair, friction: float, seed: int
) -> None:
    car = with_road(load_parameters(name), RoadParameters(friction, friction, *slopes, *wind))
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.uniform((-0.5, -300.0, -8.0), (1.0, 400.0, 8.0), (8, 3)), 20, axis=0)
    run = replay(car, v0_kmh / 3.6, np.maximum(held, (0.0, 0.0, -8.0)), 0.025)
    assert run.is_finite
    assert run.loads_n.min() >= 0.0
