"""Springs, dampers, stops, arms, compliance and steering, by how the body moves."""

from math import radians, tan

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import settle, simulate, steady_pressures_mpa
from sim_bridge.plant.parameters import Parameters, default_car, with_road_friction
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import Observation, input_table, replay, run_driver

CAR = default_car()
WHEELBASE_M = CAR.body.front_axle_m + CAR.body.rear_axle_m
PERIOD_S = 0.025


def swing(state_index: int, offset: float, name: str, car: Parameters = CAR) -> Array:
    """An output every 5 ms after a state of the settled car was moved by `offset`."""
    state = settle(20.0, car)
    state[state_index] += offset
    _, rows = simulate(state, input_table(400, 0.12), car, 5)
    swung: Array = rows[:, PlantOutputs._fields.index(name)]
    return swung


@pytest.mark.parametrize(
    ("state", "offset", "output"),
    [(AT.heave_m, 0.05, "travel_rear_left_m"), (AT.roll_rad, 0.04, "roll_rad")],
)
def test_the_released_body_hardly_swings_to_the_other_side(
    state: int, offset: float, output: str
) -> None:
    """The dampers are stiff at low speed."""
    motion = swing(state, offset, output)
    motion = motion - motion[-1]
    assert (-np.sign(motion[0]) * motion).max() < 0.25 * abs(motion[0])


def test_more_rebound_damping_slows_the_body_that_was_pressed_down() -> None:
    """Above all where the motion is fast, above the knee of the damper."""
    suspension = CAR.suspension
    slow = suspension._replace(rebound_front_nspm=2.0 * suspension.rebound_front_nspm)
    fast = suspension._replace(rebound_front_fast_nspm=2.0 * suspension.rebound_front_fast_nspm)
    after_50_ms = [
        swing(AT.heave_m, -0.05, "travel_front_left_m", CAR._replace(suspension=each))[10]
        for each in (suspension, slow, fast)
    ]
    assert after_50_ms[1] > 1.02 * after_50_ms[0]
    assert after_50_ms[2] > 1.02 * after_50_ms[0]


@pytest.mark.parametrize(("offset_m", "acts"), [(-0.11, True), (0.11, True), (-0.015, False)])
def test_stops_push_back_beyond_their_gap_only(offset_m: float, acts: bool) -> None:
    without = CAR._replace(
        suspension=CAR.suspension._replace(stop_front_npm2=0.0, stop_rear_npm2=0.0)
    )
    stopped, free = (
        np.abs(swing(AT.heave_m, offset_m, "travel_front_left_m", car)[:10])
        for car in (CAR, without)
    )
    assert CAR.suspension.stop_gap_front_m > 0.015
    assert (stopped[5] < 0.95 * free[5]) == acts
    assert acts or stopped == pytest.approx(free)


def test_the_car_dives_when_it_brakes_and_squats_when_it_accelerates() -> None:
    run = replay(CAR, 100.0 / 3.6, input_table(60, brake_n=50.0), PERIOD_S)
    pitch_deg = np.degrees(run.column("pitch_rad")[40:].mean())
    deceleration_g = -run.column("ax_mps2")[40:].mean() / GRAVITY_MPS2
    assert 1.0 < pitch_deg / deceleration_g < 1.8
    driven = replay(CAR, 10.0, input_table(80, 1.0), PERIOD_S)
    assert np.degrees(driven.column("pitch_rad")[-1]) < -0.3


@pytest.mark.parametrize("brake_n", [50.0, 90.0, 150.0])
def test_braking_moves_both_axles_within_the_usual_shares_of_arms(brake_n: float) -> None:
    """The arms carry at most 0.4 of the dive and 0.75 of the lift, the springs the rest."""
    slopes = CAR.suspension
    front_mpa, rear_mpa = steady_pressures_mpa(brake_n, car_record(CAR))
    front_nm = front_mpa * CAR.brakes.front_nm_per_mpa
    front_share = front_nm / (front_nm + rear_mpa * CAR.brakes.rear_nm_per_mpa)
    assert 0.1 < slopes.arm_slope_front * front_share * WHEELBASE_M / 0.507 < 0.4
    assert 0.1 < slopes.arm_slope_rear * (1.0 - front_share) * WHEELBASE_M / 0.507 < 0.75
    run = replay(CAR, 100.0 / 3.6, input_table(60, brake_n=brake_n), PERIOD_S)
    down_m, up_m = run.column("travel_front_left_m")[-1], -run.column("travel_rear_left_m")[-1]
    assert 0.6 < down_m / up_m < 1.3


@pytest.mark.parametrize(
    ("steer_rad", "lateral_mps2", "deg_per_n"), [(0.2, 1.33, 3.2e-5), (2.0, 7.65, 2.7e-5)]
)
def test_front_compliance_is_that_of_the_documentation(
    steer_rad: float, lateral_mps2: float, deg_per_n: float
) -> None:
    """At the limit the pneumatic trail has gone, and with it most of the part of the column."""
    run = replay(CAR, 22.0, input_table(200, 0.15, steer_rad=steer_rad), PERIOD_S)
    assert run.column("ay_mps2")[-1] == pytest.approx(lateral_mps2, rel=0.03)
    wheel_rad = run.column("road_wheel_rad")[-1]
    front_n = CAR.body.mass_kg * CAR.body.rear_axle_m / WHEELBASE_M * run.column("ay_mps2")[-1]
    given_deg = np.degrees(steer_rad / CAR.steering.ratio - wheel_rad)
    assert given_deg / front_n == pytest.approx(deg_per_n, rel=0.05)


def test_compliance_steer_acts_on_the_rear_wheels() -> None:
    """A rear axle that gives into the turn understeers more."""
    soft = CAR.suspension._replace(lateral_steer_rear_radpn=1e-6, aligning_steer_rear_radpnm=0.0)
    stiff_radps, soft_radps = (
        replay(car, 25.0, input_table(120, 0.15, steer_rad=0.3), PERIOD_S).motion[-1, 2]
        for car in (CAR, CAR._replace(suspension=soft))
    )
    assert soft_radps < 0.95 * stiff_radps


def test_a_bend_at_the_limit_keeps_all_wheels_on_the_road() -> None:
    run = replay(with_road_friction(CAR, 1.0), 25.0, input_table(200, 0.2, steer_rad=1.2), PERIOD_S)
    assert run.loads_n.min() > 100.0


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


@pytest.mark.parametrize("steer_deg", [60.0, -200.0, 400.0])
def test_at_walking_pace_the_yaw_rate_is_the_kinematic_one(steer_deg: float) -> None:
    steer_rad = radians(steer_deg) * np.minimum(1.0, np.arange(240) / 60)
    run = replay(CAR, 1.5, input_table(240, steer_rad=steer_rad), PERIOD_S)
    kinematic = run.motion[-1, 0] * tan(radians(steer_deg) / CAR.steering.ratio) / WHEELBASE_M
    assert run.motion[-1, 2] == pytest.approx(kinematic, rel=0.015)


def test_parallel_front_wheels_scrub_in_a_tight_turn() -> None:
    """With Ackermann they roll freely, and the car keeps more of its speed."""
    steer_rad = radians(400.0) * np.minimum(1.0, np.arange(240) / 60)
    free, parallel = (
        replay(
            CAR._replace(steering=CAR.steering._replace(ackermann=share)),
            1.5, input_table(240, 0.05, steer_rad=steer_rad), PERIOD_S,
        ).speed_mps[-1]
        for share in (1.0, 0.0)
    )  # fmt: skip
    assert parallel < free


def test_steering_at_standstill_meets_the_parking_torque() -> None:
    """It builds up over some degrees, then stays; at 5 m/s nearly nothing is left of it.

    While the wheel is held it is that of the road friction: what is left beside it is dry friction.
    """
    steer_rad = radians(180.0) * np.clip(np.arange(160) / 80, 0.0, 1.0)
    inputs = input_table(160, brake_n=60.0, steer_rad=steer_rad)
    standing, icy = (
        replay(with_road_friction(CAR, friction), 0.0, inputs, PERIOD_S).column("steering_wheel_nm")
        for friction in (1.0, 0.3)
    )
    assert 10.0 < standing[80] < 35.0
    assert np.ptp(standing[65:80]) < 1.0
    assert icy[120] == pytest.approx(0.3 * standing[120], rel=0.05)
    inputs = input_table(160, 0.05, steer_rad=0.3 * steer_rad)
    rolling = replay(CAR, 5.0, inputs, PERIOD_S).column("steering_wheel_nm")
    assert np.abs(rolling).max() < 0.3 * standing[80]
