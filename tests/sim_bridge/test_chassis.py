"""The chassis on its springs, in banked and in tight bends, and at walking pace."""

from math import atan, radians

import numpy as np
import pytest

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import GRAVITY_MPS2, ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.plant.library import settle, simulate
from sim_bridge.plant.parameters import Parameters, default_car
from sim_bridge.plant.protocol import PlantOutputs, RoadAt
from sim_bridge.plant.states import AT
from sim_bridge.validation.run import input_table, replay

CAR = default_car()


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


def test_without_brake_the_car_creeps_at_walking_pace() -> None:
    """The converter drives the car at idle speed."""
    assert 4.0 < replay(CAR, 0.0, input_table(600, 0.0), PERIOD_S).speed_mps[-1] * 3.6 < 8.0


def test_in_a_banked_bend_the_accelerometer_reads_less() -> None:
    """A left bend whose outer, right side is higher: a bank of minus the lateral acceleration."""
    inputs = input_table(200, 0.13, steer_rad=radians(20.0))
    flat = replay(CAR, 22.0, inputs, PERIOD_S)
    bank_rad = -atan(0.5 * flat.column("ay_mps2")[-1] / GRAVITY_MPS2)
    tilted = CAR._replace(road=CAR.road._replace(bank_rad=bank_rad))
    banked = replay(tilted, 22.0, inputs, PERIOD_S)
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
