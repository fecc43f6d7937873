"""Springs, dampers, stops, arms, compliance and steering, by how the body moves."""

from math import radians

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from sim_bridge.plant.library import settle, simulate
from sim_bridge.plant.parameters import Parameters, default_car
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import Observation, input_table, replay, run_driver

CAR = default_car()
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
