"""Dampers, stops and the give of the suspension: curves, and how the body swings."""

from math import log, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant import suspension
from sim_bridge.plant.axles import axles
from sim_bridge.plant.library import settle, simulate, steady_pressures_mpa
from sim_bridge.plant.parameters import default_car, load_parameters, with_road_friction
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import input_table, replay
from sim_bridge.validation.signal_metrics import sine_in

CAR = default_car()

FRONT, REAR = axles(CAR)
LINEAR, _ = axles(load_parameters("commonroad_vehicle_2"))


def column(outputs: Array, name: str) -> Array:
    return outputs[:, PlantOutputs._fields.index(name)]


def swing(state_index: int, offset: float, outputs: list[str], signs: list[float]) -> Array:
    """Motion (mm or mrad) after a state of the settled car was moved by `offset`."""
    state = settle(20.0, CAR)
    state[state_index] += offset
    inputs = np.tile((0.12, 0.0, 0.0), (400, 1))
    _, rows = simulate(state, inputs, CAR, 5, 0.001)
    moved = np.column_stack([column(rows, name) for name in outputs]) @ np.array(signs)
    settled: Array = moved - moved[-1]
    return settled


def damping_ratio(motion: Array) -> float:
    """From the first swing to the other side: the logarithmic decrement of half a period."""
    other_side = -np.sign(motion[0]) * motion
    decrement = log(abs(motion[0]) / other_side.max())
    return decrement / sqrt(pi**2 + decrement**2)


def test_a_damper_has_its_slopes_at_slow_and_at_fast_motion() -> None:
    assert suspension.damper_force_n(1e-4, FRONT) == pytest.approx(FRONT.jounce_nspm * 1e-4)
    assert suspension.damper_force_n(-1e-4, FRONT) == pytest.approx(-FRONT.rebound_nspm * 1e-4)
    step_n = suspension.damper_force_n(5.1, FRONT) - suspension.damper_force_n(5.0, FRONT)
    assert step_n / 0.1 == pytest.approx(FRONT.jounce_fast_nspm, rel=0.01)


def test_a_damper_with_equal_slopes_is_linear() -> None:
    for rate_mps in (-1.0, -0.1, 0.05, 0.8):
        slope_nspm = LINEAR.jounce_nspm if rate_mps > 0.0 else LINEAR.rebound_nspm
        assert suspension.damper_force_n(rate_mps, LINEAR) == pytest.approx(slope_nspm * rate_mps)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_damper_force_grows_with_speed_and_takes_energy(one: float, other: float) -> None:
    slow, fast = sorted((one, other))
    assert suspension.damper_force_n(slow, REAR) <= suspension.damper_force_n(fast, REAR) + 1e-9
    assert suspension.damper_force_n(one, REAR) * one >= 0.0


def test_stops_act_beyond_their_gap_only_and_alike_in_both_directions() -> None:
    gap_m = FRONT.stop_gap_m
    assert suspension.stop_force_n(0.9 * gap_m, FRONT) == 0.0
    beyond_n = suspension.stop_force_n(gap_m + 0.02, FRONT)
    assert beyond_n == pytest.approx(FRONT.stop_npm2 * 0.02**2)
    assert suspension.stop_force_n(-gap_m - 0.02, FRONT) == -beyond_n


def test_the_body_released_from_50_mm_swings_with_a_damping_ratio_of_a_road_car() -> None:
    travels = [f"travel_{wheel}_m" for wheel in ("front_left", "rear_left")]
    motion = swing(AT.heave_m, 0.05, travels, [-0.5, -0.5])
    assert 0.2 < damping_ratio(motion) < 0.4


def test_the_released_roll_swings_with_a_damping_ratio_of_a_road_car() -> None:
    motion = swing(AT.roll_rad, 0.04, ["roll_rad"], [1.0])
    assert 0.2 < damping_ratio(motion) < 0.45


def test_roll_follows_lateral_acceleration_as_its_natural_frequency_allows() -> None:
    """2 Hz by public inertia and stiffness, damping ratio 0.4: a lag of 27 deg at 1 Hz."""
    period_s, hz = 0.005, 1.0
    time_s = period_s * (np.arange(1000) + 0.5)
    run = replay(
        CAR, 50.0 / 3.6, input_table(1000, 0.1, steer_rad=0.35 * np.sin(2 * pi * hz * time_s)),
        period_s,
    )  # fmt: skip
    late = run.time_s >= 2.0
    roll, lateral = (
        sine_in(run.time_s[late], run.column(name)[late], hz) for name in ("roll_rad", "ay_mps2")
    )
    assert -35.0 < np.degrees(np.angle(roll / lateral)) < -15.0


@pytest.mark.parametrize(
    ("steer_rad", "lateral_mps2", "deg_per_n"), [(0.2, 1.33, 3.2e-5), (2.0, 7.65, 2.7e-5)]
)
def test_front_compliance_is_that_of_the_documentation(
    steer_rad: float, lateral_mps2: float, deg_per_n: float
) -> None:
    """At the limit the pneumatic trail has gone, and with it most of the part of the column."""
    run = replay(CAR, 22.0, input_table(200, 0.15, steer_rad=steer_rad), 0.025)
    assert run.column("ay_mps2")[-1] == pytest.approx(lateral_mps2, rel=0.03)
    wheel_rad = run.column("road_wheel_rad")[-1]
    front_n = CAR.body.mass_kg * CAR.body.rear_axle_m / 2.91 * run.column("ay_mps2")[-1]
    given_deg = np.degrees(steer_rad / CAR.steering.ratio - wheel_rad)
    assert given_deg / front_n == pytest.approx(deg_per_n, rel=0.05)


def test_compliance_steer_acts_on_the_rear_wheels() -> None:
    """A rear axle that gives into the turn understeers more."""
    stiff = replay(CAR, 25.0, input_table(120, 0.15, steer_rad=0.3), 0.025)
    soft_car = CAR._replace(
        suspension=CAR.suspension._replace(
            lateral_steer_rear_radpn=1e-6, aligning_steer_rear_radpnm=0.0
        )
    )
    soft = replay(soft_car, 25.0, input_table(120, 0.15, steer_rad=0.3), 0.025)
    assert soft.motion[-1, 2] < 0.95 * stiff.motion[-1, 2]


def test_the_car_pitches_by_the_stated_angle_per_g() -> None:
    run = replay(CAR, 100.0 / 3.6, input_table(60, brake_n=50.0), 0.025)
    pitch_deg = np.degrees(run.column("pitch_rad")[40:].mean())
    assert pitch_deg / (-run.column("ax_mps2")[40:].mean() / 9.80665) == pytest.approx(
        1.25, rel=0.12
    )


@pytest.mark.parametrize("brake_n", [50.0, 90.0, 150.0])
def test_braking_moves_both_axles_within_the_usual_shares_of_arms(brake_n: float) -> None:
    """The arms carry at most 0.4 of the dive and 0.75 of the lift, the springs the rest."""
    body, slopes = CAR.body, CAR.suspension
    front_mpa, rear_mpa = steady_pressures_mpa(brake_n, CAR.brakes)
    front_nm = front_mpa * CAR.brakes.front_nm_per_mpa
    front_share = front_nm / (front_nm + rear_mpa * CAR.brakes.rear_nm_per_mpa)
    wheelbase_over_height = (body.front_axle_m + body.rear_axle_m) / 0.507
    assert 0.1 < slopes.arm_slope_front * front_share * wheelbase_over_height < 0.4
    assert 0.1 < slopes.arm_slope_rear * (1.0 - front_share) * wheelbase_over_height < 0.75
    run = replay(CAR, 100.0 / 3.6, input_table(60, brake_n=brake_n), 0.025)
    down_m, up_m = run.column("travel_front_left_m")[-1], -run.column("travel_rear_left_m")[-1]
    assert 0.6 < down_m / up_m < 1.3


def test_arms_act_by_where_the_torque_of_a_wheel_is_carried() -> None:
    """Brake torque: by the arms, so at the road. Drive torque: by the body, so at the centre."""
    braked_n = suspension.arm_force_n(2, -1000.0, 0.0, 0.0, 0.0, 0.0, REAR, CAR.body)
    driven_n = suspension.arm_force_n(2, 1000.0, 0.0, 1000.0, 0.0, 0.0, REAR, CAR.body)
    assert braked_n == pytest.approx(-1000.0 * CAR.suspension.arm_slope_rear)
    assert driven_n == pytest.approx(1000.0 * CAR.suspension.centre_slope_rear)


@pytest.mark.parametrize("name", ["c_class_150kw_awd", "c_class_125kw_fwd", "c_class_150kw_bev"])
def test_ride_frequencies_are_usual_and_the_rear_swings_faster(name: str) -> None:
    """Of the body on springs alone; the faster rear axle lets pitch die after a bump."""
    car = load_parameters(name)
    hz = [
        sqrt(2.0 * axle.spring_npm / (2.0 * axle.rest_load_n / GRAVITY_MPS2 - 2.0 * axle.wheel_kg))
        / (2.0 * pi)
        for axle in axles(car)
    ]
    assert 1.0 < hz[0] < hz[1] < 1.5


def test_a_bend_at_the_limit_keeps_all_wheels_on_the_road() -> None:
    run = replay(with_road_friction(CAR, 1.0), 25.0, input_table(200, 0.2, steer_rad=1.2), 0.025)
    assert run.loads_n.min() > 100.0
