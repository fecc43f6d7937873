"""The whole car in motion: properties that hold for any parameters."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.signals import ControlInput
from sim_bridge import frenet
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, advance, settle, simulate
from sim_bridge.plant.parameters import Parameters, default_car, load_parameters, with_road_friction
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.plant.states import AT, N_STATES, WHEEL_STATES, StateIndex

CAR = default_car()
MIRROR = np.array((1.0, -1.0, -1.0))
CARS = tuple(load_parameters(name) for name in shipped_cars())
TOP_HEAVY = CARS[shipped_cars().index("commonroad_vehicle_2")]
"""narrow, high, with tyres whose grip is sufficient to roll it over"""


@dataclass(frozen=True, slots=True)
class Run:
    motion: Array
    outputs: Array

    def column(self, name: str) -> Array:
        return self.outputs[:, PlantOutputs._fields.index(name)]

    def spins(self) -> Array:
        first = PlantOutputs._fields.index("spin_front_left_radps")
        return self.outputs[:, first : first + 4]

    def loads(self) -> Array:
        first = PlantOutputs._fields.index("load_front_left_n")
        return self.outputs[:, first : first + 4]


def drive(v0_kmh: float, inputs: Array, car: Parameters = CAR, steps: int = 25) -> Run:
    return Run(*simulate(settle(v0_kmh / 3.6, car), inputs, car, steps, 0.025 / steps))


def held(
    seconds: float, throttle: float = 0.0, brake_n: float = 0.0, steer_deg: float = 0.0
) -> Array:
    return np.tile((throttle, brake_n, np.radians(steer_deg)), (round(seconds / 0.025), 1))


def lane_change(amplitude_deg: float) -> Array:
    """One period of a sine at the wheel, 0.4 Hz, with a little throttle."""
    inputs = held(4.0, throttle=0.15)
    t = np.arange(len(inputs)) * 0.025
    inputs[:, 2] = np.radians(amplitude_deg) * np.sin(2 * np.pi * 0.4 * t) * (t < 2.5)
    return inputs


def random_inputs(rng: np.random.Generator, seconds: float, steer_deg: float) -> Array:
    """Random steps of pedals and steering wheel, also both pedals at once."""
    inputs = held(seconds)
    hold = int(rng.integers(1, 60))
    for k in range(0, len(inputs), hold):
        inputs[k : k + hold] = (
            rng.uniform() * (rng.uniform() < 0.5),
            rng.uniform(0.0, 150.0) * (rng.uniform() < 0.5),
            np.radians(rng.uniform(-steer_deg, steer_deg)),
        )
    return inputs


def test_state_names_cover_the_vector_without_gaps() -> None:
    covered = [
        getattr(AT, name) + wheel
        for name in StateIndex._fields
        for wheel in range(4 if name in WHEEL_STATES else 1)
    ]
    assert sorted(covered) == list(range(N_STATES))


def test_wheel_loads_at_rest_are_the_published_ones() -> None:
    loads = drive(0.0, held(0.5, brake_n=60.0)).loads()[-1]
    assert loads.sum() == pytest.approx(CAR.body.mass_kg * GRAVITY_MPS2, rel=1e-6)
    np.testing.assert_allclose(loads, (4705.0, 4705.0, 2655.0, 2655.0), rtol=0.005)


def test_the_sum_of_wheel_loads_is_the_weight_in_a_steady_turn() -> None:
    """Less the aerodynamic lift; the lateral load transfer balances the moments."""
    run = drive(80.0, held(6.0, throttle=0.13, steer_deg=30.0))
    speed_mps = run.motion[-1, 0]
    lift_n = 0.5 * CAR.aero.air_density_kgpm3 * CAR.aero.area_m2 * CAR.aero.lift * speed_mps**2
    loads = run.loads()[-1]
    assert loads.sum() + lift_n == pytest.approx(CAR.body.mass_kg * GRAVITY_MPS2, rel=2e-3)
    moment_nm = 0.5 * CAR.body.track_front_m * (loads[1] + loads[3] - loads[0] - loads[2])
    overturning_nm = CAR.body.mass_kg * 0.507 * run.column("ay_mps2")[-1]
    sway_nm = CAR.body.sprung_mass_kg * 0.52 * GRAVITY_MPS2 * run.column("roll_rad")[-1]
    assert moment_nm == pytest.approx(overturning_nm + sway_nm, rel=0.02)


@pytest.mark.parametrize(("v0_kmh", "amplitude_deg"), [(80.0, 40.0), (120.0, 40.0), (60.0, 120.0)])
def test_mirrored_steering_gives_the_mirrored_run(v0_kmh: float, amplitude_deg: float) -> None:
    inputs = lane_change(amplitude_deg)
    left = drive(v0_kmh, inputs)
    right = drive(v0_kmh, inputs * (1.0, 1.0, -1.0))
    np.testing.assert_allclose(right.motion * MIRROR, left.motion, atol=1e-9)


@pytest.mark.parametrize(
    ("v0_kmh", "amplitude_deg", "yaw_rate_degps", "lateral_limit_m"),
    [
        (80.0, 40.0, 0.1, 0.005),
        (120.0, 40.0, 0.1, 0.005),
        (60.0, 120.0, 0.1, 0.005),
        (80.0, 120.0, 0.1, 0.005),
        (120.0, 100.0, 0.2, 0.045),
    ],
)
def test_half_the_step_gives_the_same_lane_change(
    v0_kmh: float, amplitude_deg: float, yaw_rate_degps: float, lateral_limit_m: float
) -> None:
    """Also with saturated tyres; at 120 km/h and 100 deg the car slides and drifts by 46 m."""
    inputs = lane_change(amplitude_deg)
    coarse = drive(v0_kmh, inputs)
    fine = drive(v0_kmh, inputs, steps=50)
    assert np.degrees(np.abs(coarse.motion[:, 2]).max()) > 5.0
    change = np.degrees(np.abs(fine.motion[::2, 2] - coarse.motion[:, 2]).max())
    assert change < yaw_rate_degps
    lateral_m = frenet.integrate_poses(coarse.motion, 0.0, 0.0, 0.0, 25, 0.001)[:, frenet.EY]
    fine_lateral_m = frenet.integrate_poses(fine.motion, 0.0, 0.0, 0.0, 50, 0.0005)[:, frenet.EY]
    assert np.abs(lateral_m).max() > 1.0
    assert np.abs(lateral_m - fine_lateral_m).max() < lateral_limit_m


@pytest.mark.parametrize("v0_kmh", [50.0, 90.0, 130.0])
def test_coasting_straight_never_gains_energy(v0_kmh: float) -> None:
    """With the throttle closed, in gear, including down-shifts."""
    run = drive(v0_kmh, held(30.0))
    closed = run.column("throttle") < 1e-3
    spin = run.spins()[closed]
    speed = run.motion[::25, 0][closed]
    energy_j = 0.5 * CAR.body.mass_kg * speed**2
    energy_j += 0.5 * CAR.tyre.spin_inertia_kgm2 * (spin**2).sum(axis=1)
    rolling = speed[1:] > 4.0
    assert rolling.sum() > 200
    assert np.all(np.diff(energy_j)[rolling] < 0.0)


def test_coasting_in_turns_never_gains_energy_over_a_second() -> None:
    inputs = held(12.0)
    inputs[:, 2] = np.radians(35.0) * np.sin(np.arange(len(inputs)) * 0.025 * 2.0)
    motion = drive(110.0, inputs).motion[::1000]
    energy_j = 0.5 * CAR.body.mass_kg * (motion[:, 0] ** 2 + motion[:, 1] ** 2)
    energy_j += 0.5 * CAR.body.yaw_inertia_kgm2 * motion[:, 2] ** 2
    assert np.all(np.diff(energy_j) < 0.0)


@pytest.mark.parametrize("steer_deg", [0.0, 40.0, -120.0])
def test_a_car_at_rest_with_brake_does_not_move(steer_deg: float) -> None:
    """The idling engine pitches the braked body; steering it then moves it by micrometres."""
    run = drive(0.0, held(20.0, brake_n=60.0, steer_deg=steer_deg))
    assert np.abs(run.motion).max() < (1e-9 if steer_deg == 0.0 else 5e-6)
    assert np.abs(run.motion[5000:]).max() < 1e-9
    assert np.abs(run.motion.sum(axis=0) * 0.001).max() < 5e-6
    assert np.abs(run.column("roll_rad")).max() < (1e-9 if steer_deg == 0.0 else 1e-5)


def test_without_brake_the_car_creeps_at_walking_pace() -> None:
    """The converter drives the car at idle speed."""
    final_kmh = drive(0.0, held(15.0)).motion[-1, 0] * 3.6
    assert 4.0 < final_kmh < 8.0


@pytest.mark.parametrize("road", [0.3, 0.85, 1.0])
def test_full_braking_ends_at_rest(road: float) -> None:
    """Also with locked wheels; the oscillation on the tyres decays."""
    run = drive(60.0, held(10.0, brake_n=150.0), with_road_friction(CAR, road))
    assert run.motion[:, 0].min() > -0.1
    assert np.abs(run.motion[-1000:]).max() < 0.01
    assert np.abs(run.spins()[-40:]).max() < 0.05


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    car=st.sampled_from(CARS),
    v0_kmh=st.floats(0.0, 200.0),
    friction_left=st.floats(0.2, 1.1),
    friction_right=st.one_of(st.none(), st.floats(0.2, 1.1)),
    seed=st.integers(0, 2**32 - 1),
)
def test_random_driving_stays_finite(
    car: Parameters, v0_kmh: float, friction_left: float, friction_right: float | None, seed: int
) -> None:
    """From rest to 200 km/h, on ice, asphalt or half on each, both pedals and +-120 deg."""
    road = with_road_friction(car, friction_left, friction_right)
    inputs = random_inputs(np.random.default_rng(seed), 8.0, 120.0)
    run = drive(v0_kmh, inputs, road)
    assert np.all(np.isfinite(run.motion))
    assert np.all(np.isfinite(run.outputs))
    assert np.all(run.loads() >= 0.0)
    if car is not TOP_HEAVY:
        assert np.abs(run.outputs[:, :2]).max() < 1.3 * GRAVITY_MPS2
        assert np.degrees(np.abs(run.column("roll_rad")).max()) < 8.0


@pytest.mark.parametrize(
    ("v0_kmh", "throttle", "brake_n"), [(0.0, 1.0, 0.0), (200.0, 1.0, 0.0), (200.0, 0.0, 150.0)]
)
@pytest.mark.parametrize("steer_deg", [0.0, 120.0, -120.0])
@pytest.mark.parametrize("road", [0.2, 1.1])
def test_full_pedal_and_full_steering_stay_finite(
    v0_kmh: float, throttle: float, brake_n: float, steer_deg: float, road: float
) -> None:
    run = drive(v0_kmh, held(12.0, throttle, brake_n, steer_deg), with_road_friction(CAR, road))
    assert np.all(np.isfinite(run.motion))
    assert np.all(np.isfinite(run.outputs))


def test_the_roll_angle_of_a_car_that_rolls_over_ends_at_90_degrees() -> None:
    tall = TOP_HEAVY._replace(body=TOP_HEAVY.body._replace(sprung_height_m=1.2))
    run = drive(120.0, held(8.0, steer_deg=120.0), with_road_friction(tall, 1.1))
    assert np.all(np.isfinite(run.outputs))
    assert np.degrees(run.column("roll_rad")).max() == pytest.approx(90.0, abs=0.1)


def test_braking_with_one_slippery_side_yaws_to_the_other_side() -> None:
    """With ice on the left the car turns right, with ice on the right it turns left."""
    ice_left = drive(60.0, held(1.0, brake_n=60.0), with_road_friction(CAR, 0.2, 0.9))
    ice_right = drive(60.0, held(1.0, brake_n=60.0), with_road_friction(CAR, 0.9, 0.2))
    assert np.degrees(ice_left.motion[-1, 2]) < -2.0
    np.testing.assert_allclose(ice_right.motion * MIRROR, ice_left.motion, atol=1e-9)


@pytest.mark.parametrize("v0_kmh", [30.0, 55.0, 80.0, 105.0, 130.0])
def test_a_settled_car_keeps_its_speed_gear_and_engine_speed(v0_kmh: float) -> None:
    state = settle(v0_kmh / 3.6, CAR)
    assert state[AT.vx_mps] == v0_kmh / 3.6
    run = drive(v0_kmh, held(0.5, throttle=float(state[AT.throttle])))
    assert np.abs(run.motion[:, 0] - v0_kmh / 3.6).max() < 0.05
    assert np.ptp(run.column("gear")) == 0.0
    assert np.ptp(run.column("engine_rpm")) < 20.0


@pytest.mark.parametrize("v0_mps", [-1.0, float("nan")])
def test_an_initial_speed_that_is_negative_or_nan_is_refused(v0_mps: float) -> None:
    with pytest.raises(ConfigError, match="initial speed: expected"):
        settle(v0_mps, CAR)


def test_an_episode_equals_its_periods_in_sequence() -> None:
    inputs = random_inputs(np.random.default_rng(5), 3.0, 40.0)
    state = settle(25.0, CAR)
    untouched = state.copy()
    motion, _ = simulate(state, inputs, CAR, STEPS_PER_PERIOD, STEP_S)
    np.testing.assert_array_equal(state, untouched)
    piece, car = np.empty((STEPS_PER_PERIOD, 3)), car_record(CAR)
    for k, (throttle, brake_n, steer_rad) in enumerate(inputs):
        control = ControlInput(throttle, brake_n, steer_rad)
        advance(state, control, car, STEPS_PER_PERIOD, STEP_S, piece)
        first = k * STEPS_PER_PERIOD + 1
        np.testing.assert_array_equal(piece, motion[first : first + STEPS_PER_PERIOD])


def test_accelerations_of_the_outputs_are_those_of_the_motion() -> None:
    run = drive(90.0, lane_change(30.0))
    middle = slice(25, -25, 25)
    slope = np.gradient(run.motion, STEP_S, axis=0)
    ax = slope[:, 0] - run.motion[:, 2] * run.motion[:, 1]
    ay = slope[:, 1] + run.motion[:, 2] * run.motion[:, 0]
    np.testing.assert_allclose(run.column("ax_mps2")[1:-1], ax[middle], atol=0.05)
    np.testing.assert_allclose(run.column("ay_mps2")[1:-1], ay[middle], atol=0.05)
