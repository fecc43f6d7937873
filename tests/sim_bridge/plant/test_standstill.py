"""The car at rest and at walking pace: stops, parking, kinematic steering."""

from math import atan, degrees, radians, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_tyre import TYRE_FILE_TEXT

from sim_bridge.plant import steering
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import Parameters, default_car, with_road_friction
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.tyre import tyres
from sim_bridge.plant.tyre_file import parse_tyre_file
from sim_bridge.validation.run import input_table, replay

CAR = default_car()

WHEELBASE_M = CAR.body.front_axle_m + CAR.body.rear_axle_m
PERIOD_S = 0.025


@pytest.mark.parametrize("friction", [0.3, 0.85, 1.0])
def test_after_a_locked_stop_the_car_rocks_back_only_slightly(friction: float) -> None:
    car = with_road_friction(CAR, friction)
    seconds = 4.0 + 17.0 / (8.0 * friction)
    run = replay(car, 17.0, input_table(round(seconds / PERIOD_S), brake_n=400.0), PERIOD_S)
    assert run.motion[:, 0].min() > -0.1
    assert np.ptp(run.x_m[-40:]) < 1e-4
    assert np.abs(run.motion[-40:]).max() < 1e-6


@pytest.mark.parametrize("steer_deg", [60.0, -200.0, 400.0])
def test_at_walking_pace_the_yaw_rate_is_the_kinematic_one(steer_deg: float) -> None:
    n = 240
    steer_rad = radians(steer_deg) * np.minimum(1.0, np.arange(n) / 60)
    run = replay(CAR, 1.5, input_table(n, steer_rad=steer_rad), PERIOD_S)
    kinematic = run.motion[-1, 0] * tan(radians(steer_deg) / CAR.steering.ratio) / WHEELBASE_M
    assert run.motion[-1, 2] == pytest.approx(kinematic, rel=0.015)


def test_steering_at_standstill_meets_the_parking_torque() -> None:
    """It builds up over some degrees, then stays; at 5 m/s nearly nothing is left of it."""
    steer_rad = radians(180.0) * np.clip(np.arange(160) / 80, 0.0, 1.0)
    inputs = input_table(160, brake_n=60.0, steer_rad=steer_rad)
    standing = replay(CAR, 0.0, inputs, PERIOD_S).column("steering_wheel_nm")
    assert 10.0 < standing[80] < 35.0
    assert np.ptp(standing[65:80]) < 1.0
    inputs = input_table(160, 0.05, steer_rad=0.3 * steer_rad)
    rolling = replay(CAR, 5.0, inputs, PERIOD_S).column("steering_wheel_nm")
    assert np.abs(rolling).max() < 0.3 * standing[80]


def test_the_parking_torque_is_proportional_to_the_friction_of_the_road() -> None:
    """Measured while the steering wheel is held: what is left beside it is dry friction."""
    steer_rad = radians(180.0) * np.minimum(1.0, np.arange(120) / 80)
    inputs = input_table(120, brake_n=60.0, steer_rad=steer_rad)
    dry_nm, icy_nm = (
        replay(with_road_friction(CAR, friction), 0.0, inputs, PERIOD_S).column(
            "steering_wheel_nm"
        )[-1]
        for friction in (1.0, 0.3)
    )
    assert dry_nm > 10.0
    assert icy_nm == pytest.approx(0.3 * dry_nm, rel=0.05)


@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_a_standing_tyre_holds_the_force_of_the_road_friction(friction: float) -> None:
    """The limit of its slip is where the contact slides: stiffness times slip is friction."""
    slip = tyres.largest_slip(0.0, friction, CAR.tyre)
    assert CAR.tyre.slip_stiffness * slip == pytest.approx(
        friction * CAR.tyre.longitudinal_friction
    )


def test_a_parked_car_does_not_move_while_it_is_steered() -> None:
    steer_rad = radians(300.0) * np.sin(np.arange(240) / 30)
    run = replay(CAR, 0.0, input_table(240, brake_n=60.0, steer_rad=steer_rad), PERIOD_S)
    assert np.abs(run.motion).max() < 1e-6


@pytest.mark.parametrize(
    "car",
    [
        CAR._replace(tyre=CAR.tyre._replace(spin_inertia_kgm2=0.8)),
        CAR._replace(tyre_file=parse_tyre_file(TYRE_FILE_TEXT, "made")[0]._replace(pkx1=40.0)),
    ],
    ids=["light wheels", "stiff tyres"],
)
def test_wheels_that_start_to_turn_do_not_oscillate(car: Parameters) -> None:
    """The spins are those of integration steps four times as fine."""
    inputs = input_table(40, 0.1)
    coarse, fine = (
        simulate(settle(0.0, car), inputs, car, n * STEPS_PER_PERIOD, STEP_S / n)[1] for n in (1, 4)
    )
    first = PlantOutputs._fields.index("spin_front_left_radps")
    spins = slice(first, first + 4)
    np.testing.assert_allclose(coarse[:, spins], fine[:, spins], atol=0.005)


@settings(deadline=None)  # the first example compiles
@given(
    turn_radps=st.floats(-5.0, 5.0),
    speed_mps=st.floats(0.0, 40.0),
    twist_share=st.floats(-1.0, 1.0),
)
def test_the_twist_of_a_contact_never_leaves_its_limit(
    turn_radps: float, speed_mps: float, twist_share: float
) -> None:
    """At the limit its rate points back."""
    limit_rad = CAR.tyre.parking_twist_rad
    decay = steering.twist_decay_per_s(turn_radps, speed_mps, CAR.tyre)
    if decay > 1e-9:
        final_rad = turn_radps / decay
        assert abs(final_rad) <= limit_rad * (1.0 + 1e-9)
    moment_nm = steering.parking_nm(twist_share * limit_rad, 4500.0, 1.0, CAR.tyre)
    assert abs(moment_nm) <= CAR.tyre.parking_torque_nm
    assert moment_nm * twist_share <= 0.0


def test_the_front_wheels_turn_about_one_point() -> None:
    """Ackermann: the inner wheel turns more, the axes meet on that of the rear axle."""
    half_m, mean_rad = CAR.body.track_front_m / 2.0, radians(20.0)
    left, right = (
        steering.ackermann_rad(mean_rad, side, half_m, WHEELBASE_M, 1.0) for side in (1.0, -1.0)
    )
    radius_m = WHEELBASE_M / tan(mean_rad)
    assert left == pytest.approx(atan(WHEELBASE_M / (radius_m - half_m)))
    assert right == pytest.approx(atan(WHEELBASE_M / (radius_m + half_m)))
    parallel = steering.ackermann_rad(mean_rad, 1.0, half_m, WHEELBASE_M, 0.0)
    assert parallel == pytest.approx(mean_rad)
    assert degrees(left - right) > 3.0
