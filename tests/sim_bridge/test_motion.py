"""The whole car in motion and at rest: properties that hold for any parameters and roads."""

from ctypes import byref, c_int

import numpy as np
import pytest
from golden_drives import GOLDEN_FILE, trajectories, wandering_inputs
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge import frenet
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.library import (
    N_OUTPUTS,
    STEP_S,
    STEPS_PER_PERIOD,
    car_library,
    car_record,
    settle,
    simulate,
)
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    load_parameters,
    with_road,
    with_road_friction,
)
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.plant.states import AT, N_STATES
from sim_bridge.validation.run import (
    Observation,
    Run,
    cruising_throttle,
    input_table,
    replay,
    run_driver,
)


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


CAR = default_car()
MIRROR = np.array((1.0, -1.0, -1.0))
CARS = {name: load_parameters(name) for name in shipped_cars()}
TOP_HEAVY = CARS["commonroad_vehicle_2"]
"""narrow, high, with tyres whose grip is sufficient to roll it over"""


def drive(v0_kmh: float, inputs: Array, car: Parameters = CAR, step_s: float = STEP_S) -> Run:
    return replay(car, v0_kmh / 3.6, inputs, 0.025, step_s)


def held(
    seconds: float, throttle: float = 0.0, brake_n: float = 0.0, steer_deg: float = 0.0
) -> Array:
    return input_table(round(seconds / 0.025), throttle, brake_n, np.radians(steer_deg))


def lane_change(amplitude_deg: float) -> Array:
    """One period of a sine at the wheel, 0.4 Hz, with a little throttle."""
    t = np.arange(160) * 0.025
    steer_deg = amplitude_deg * np.sin(2 * np.pi * 0.4 * t) * (t < 2.5)
    return input_table(160, 0.15, steer_rad=np.radians(steer_deg))


def random_inputs(seed: int, seconds: float, steer_deg: float) -> Array:
    """Random steps of pedals and steering wheel, also both pedals at once."""
    rng, inputs = np.random.default_rng(seed), held(seconds)
    hold = int(rng.integers(1, 60))
    for k in range(0, len(inputs), hold):
        pedals = rng.uniform(0.0, (1.0, 150.0)) * (rng.uniform(size=2) < 0.5)
        inputs[k : k + hold] = (*pedals, np.radians(rng.uniform(-steer_deg, steer_deg)))
    return inputs


def test_the_sum_of_wheel_loads_is_the_weight_at_rest_and_in_a_steady_turn() -> None:
    """Less the aerodynamic lift; the lateral load transfer balances the moments."""
    at_rest_n = drive(0.0, held(0.5, brake_n=60.0)).loads_n[-1]
    assert at_rest_n.sum() == pytest.approx(CAR.body.mass_kg * GRAVITY_MPS2, rel=1e-6)
    np.testing.assert_allclose(at_rest_n, (4705.0, 4705.0, 2655.0, 2655.0), rtol=0.005)
    run = drive(80.0, held(6.0, throttle=0.13, steer_deg=30.0))
    lift_n = CAR.aero.air_density_kgpm3 * CAR.aero.area_m2 * CAR.aero.lift * 0.5
    lift_n *= run.speed_mps[-1] ** 2
    loads_n = run.loads_n[-1]
    assert loads_n.sum() + lift_n == pytest.approx(CAR.body.mass_kg * GRAVITY_MPS2, rel=2e-3)
    moment_nm = 0.5 * CAR.body.track_front_m * (loads_n @ (-1.0, 1.0, -1.0, 1.0))
    overturning_nm = CAR.body.mass_kg * 0.507 * run.column("ay_mps2")[-1]
    sway_nm = CAR.body.sprung_mass_kg * 0.52 * GRAVITY_MPS2 * run.column("roll_rad")[-1]
    assert moment_nm == pytest.approx(overturning_nm + sway_nm, rel=0.02)


def test_mirrored_steering_gives_the_mirrored_run() -> None:
    inputs = lane_change(120.0)
    left, right = drive(60.0, inputs), drive(60.0, inputs * (1.0, 1.0, -1.0))
    np.testing.assert_allclose(right.motion * MIRROR, left.motion, atol=1e-9)


@pytest.mark.parametrize(
    ("v0_kmh", "amplitude_deg", "yaw_rate_degps", "lateral_limit_m"),
    [(120.0, 40.0, 0.1, 0.005), (80.0, 120.0, 0.1, 0.005), (120.0, 100.0, 0.2, 0.045)],
)
def test_half_the_step_gives_the_same_lane_change(
    v0_kmh: float, amplitude_deg: float, yaw_rate_degps: float, lateral_limit_m: float
) -> None:
    """Also with saturated tyres; at 120 km/h and 100 deg the car slides and drifts by 46 m."""
    inputs = lane_change(amplitude_deg)
    coarse, fine = (drive(v0_kmh, inputs, step_s=step_s) for step_s in (STEP_S, STEP_S / 2))
    assert np.abs(coarse.yaw_rate_degps).max() > 5.0
    assert np.abs(fine.yaw_rate_degps - coarse.yaw_rate_degps).max() < yaw_rate_degps
    assert np.abs(coarse.y_m).max() > 1.0
    assert np.abs(coarse.y_m - fine.y_m).max() < lateral_limit_m


def test_coasting_straight_never_gains_energy() -> None:
    """With the throttle closed, in gear, including down-shifts."""
    run = drive(90.0, held(30.0))
    energy_j = 0.5 * CAR.body.mass_kg * run.speed_mps**2
    energy_j += 0.5 * CAR.tyre.spin_inertia_kgm2 * (run.spins_radps**2).sum(axis=1)
    rolling = (run.column("throttle")[:-1] < 1e-3) & (run.speed_mps[1:] > 4.0)
    assert rolling.sum() > 200
    assert np.all(np.diff(energy_j)[rolling] < 0.0)


def test_coasting_in_turns_never_gains_energy_over_a_second() -> None:
    steer_rad = np.radians(35.0) * np.sin(np.arange(480) * 0.025 * 2.0)
    motion = drive(110.0, input_table(480, steer_rad=steer_rad)).motion[::40]
    masses = CAR.body.mass_kg, CAR.body.mass_kg, CAR.body.yaw_inertia_kgm2
    assert np.all(np.diff(0.5 * motion**2 @ masses) < 0.0)


@pytest.mark.parametrize("steer_deg", [0.0, -120.0])
def test_a_car_at_rest_with_brake_does_not_move(steer_deg: float) -> None:
    """Also while it is steered; that moves the body, which the idling engine pitches, by um."""
    swung_rad = 2.5 * np.radians(steer_deg) * np.sin(np.arange(240) / 30)
    swung = drive(0.0, input_table(240, brake_n=60.0, steer_rad=swung_rad))
    assert np.abs(swung.motion).max() < 1e-6
    run = drive(0.0, held(20.0, brake_n=60.0, steer_deg=steer_deg))
    assert np.abs(run.motion).max() < (1e-9 if steer_deg == 0.0 else 5e-6)
    assert np.abs(run.motion[200:]).max() < 1e-9
    assert np.abs(run.pose).max() < 5e-6
    assert np.abs(run.column("roll_rad")).max() < (1e-9 if steer_deg == 0.0 else 1e-5)


@pytest.mark.parametrize(("friction", "brake_n"), [(0.3, 400.0), (1.0, 150.0)])
def test_braking_ends_at_rest_and_rocks_back_only_slightly(friction: float, brake_n: float) -> None:
    """Also with locked wheels; the oscillation on the tyres decays."""
    run = drive(61.0, held(12.0, brake_n=brake_n), with_road_friction(CAR, friction))
    assert run.speed_mps.min() > -0.1
    assert np.ptp(run.x_m[-40:]) < 1e-4
    assert np.abs(run.motion[-40:]).max() < 1e-6
    assert np.abs(run.spins_radps[-40:]).max() < 0.05


Pair = tuple[float, float]
frictions, angles, winds = st.floats(0.1, 1.2), st.floats(-0.3, 0.3), st.floats(-30.0, 30.0)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    name=st.sampled_from(shipped_cars()),
    v0_kmh=st.floats(0.0, 200.0),
    friction=st.tuples(frictions, frictions),
    slope=st.just((0.0, 0.0)) | st.tuples(angles, angles),
    wind=st.tuples(winds, winds),
    steer_deg=st.sampled_from((120.0, 460.0)),
    seed=st.integers(0, 2**32 - 1),
)
def test_random_driving_stays_finite(
    name: str, v0_kmh: float, friction: Pair, slope: Pair, wind: Pair, steer_deg: float, seed: int
) -> None:
    """From rest to 200 km/h, on ice, asphalt or half on each, both pedals, slopes and storm."""
    car = with_road(CARS[name], RoadParameters(*friction, *slope, *wind))
    run = drive(v0_kmh, random_inputs(seed, 8.0, steer_deg), car)
    assert run.loads_n.min() >= 0.0
    if slope == (0.0, 0.0) and CARS[name] is not TOP_HEAVY:
        assert np.abs(run.outputs[:, :2]).max() < 1.5 * GRAVITY_MPS2
        assert np.abs(run.roll_deg).max() < 8.0


def test_the_roll_angle_of_a_car_that_rolls_over_ends_at_90_degrees() -> None:
    tall = TOP_HEAVY._replace(body=TOP_HEAVY.body._replace(sprung_height_m=1.2))
    run = drive(120.0, held(8.0, steer_deg=120.0), with_road_friction(tall, 1.1))
    assert run.roll_deg.max() == pytest.approx(90.0, abs=0.1)


@pytest.mark.parametrize("v0_kmh", [30.0, 130.0])
def test_a_settled_car_keeps_its_speed_gear_and_engine_speed(v0_kmh: float) -> None:
    state = settle(v0_kmh / 3.6, CAR)
    assert state[AT.vx_mps] == v0_kmh / 3.6
    run = drive(v0_kmh, held(0.5, throttle=float(state[AT.throttle])))
    assert np.abs(run.speed_mps - v0_kmh / 3.6).max() < 0.05
    assert np.ptp(run.column("gear")) == 0.0
    assert np.ptp(run.column("engine_rpm")) < 20.0


@pytest.mark.parametrize("v0_mps", [-1.0, float("nan")])
def test_an_initial_speed_that_is_negative_or_nan_is_refused(v0_mps: float) -> None:
    with pytest.raises(ConfigError, match="initial speed: expected"):
        settle(v0_mps, CAR)


def test_accelerations_of_the_outputs_are_those_of_the_motion() -> None:
    motion, _ = simulate(settle(25.0, CAR), lane_change(30.0), CAR)
    slope, middle = np.gradient(motion, STEP_S, axis=0), slice(25, -25, 25)
    ax = slope[:, 0] - motion[:, 2] * motion[:, 1]
    ay = slope[:, 1] + motion[:, 2] * motion[:, 0]
    run = drive(90.0, lane_change(30.0))
    np.testing.assert_allclose(run.column("ax_mps2")[1:-1], ax[middle], atol=0.05)
    np.testing.assert_allclose(run.column("ay_mps2")[1:-1], ay[middle], atol=0.05)


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


def test_the_car_dives_when_it_brakes_and_squats_when_it_accelerates() -> None:
    run = replay(CAR, 100.0 / 3.6, input_table(60, brake_n=50.0), PERIOD_S)
    pitch_deg = np.degrees(run.column("pitch_rad")[40:].mean())
    deceleration_g = -run.column("ax_mps2")[40:].mean() / GRAVITY_MPS2
    assert 1.0 < pitch_deg / deceleration_g < 1.8
    driven = replay(CAR, 10.0, input_table(80, 1.0), PERIOD_S)
    assert np.degrees(driven.column("pitch_rad")[-1]) < -0.3


def test_the_car_understeers_and_does_not_spin_beyond_the_limit() -> None:
    """At 100 km/h with an increasing steering angle: it still turns less than it is steered."""
    v0_mps = 100.0 / 3.6

    def driver(now: Observation) -> ControlInput:
        throttle = float(np.clip(0.3 + 0.5 * (v0_mps - now.vx_mps), 0.0, 1.0))
        return ControlInput(throttle, 0.0, float(np.radians(10.0 * now.time_s)))

    run = run_driver(CAR, v0_mps, driver, 12.0, PERIOD_S)
    _, vy_mps, yaw_rate_radps = run.motion[-1]
    front_rad = (vy_mps + CAR.body.front_axle_m * yaw_rate_radps) / run.speed_mps[-1]
    rear_rad = (vy_mps - CAR.body.rear_axle_m * yaw_rate_radps) / run.speed_mps[-1]
    front_slip = abs(front_rad - run.column("road_wheel_rad")[-1])
    assert 0.7 < run.lateral_g.max() < 0.85
    assert front_slip > 1.5 * abs(rear_rad)
    assert abs(run.sideslip_deg[-1]) < 5.0
