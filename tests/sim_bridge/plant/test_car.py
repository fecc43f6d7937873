"""`Car`: the own car on a road, stepped by the control period."""

import numpy as np
import pytest
from wandering_inputs import wandering_inputs

from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge import frenet
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt

PARAMETERS = default_car()
CURVATURE_PER_M = 0.002


def test_a_car_stepped_by_periods_equals_the_simulated_episode() -> None:
    """To the last bit."""
    inputs = wandering_inputs(120)
    car = Car(OwnCar(PARAMETERS), 22.0)
    car.reset(22.0, ey_m=-0.7, epsi_rad=0.03)
    states = [car.advance(control, CURVATURE_PER_M) for control in inputs]

    motion, _ = simulate(settle(22.0, PARAMETERS), np.array(inputs), PARAMETERS)
    poses = frenet.integrate_poses(motion, CURVATURE_PER_M, -0.7, 0.03, STEPS_PER_PERIOD, STEP_S)
    seen = np.array(states)
    np.testing.assert_array_equal(seen[:, :3], motion[STEPS_PER_PERIOD::STEPS_PER_PERIOD])
    np.testing.assert_array_equal(seen[:, 3], np.diff(poses[:, frenet.S]))
    np.testing.assert_array_equal(seen[:, 4:], poses[1:, 1:])


def test_a_road_that_changes_by_the_period_acts_as_behind_the_bridge() -> None:
    """To the last bit."""
    inputs = wandering_inputs(80)
    k = np.arange(80)
    flat = np.tile(np.array(PARAMETERS.road), (80, 1))
    roads = flat + 0.02 * np.sin(0.1 * k[:, None] + np.arange(6))
    roads[40:, 0] = 0.4
    at_start = PARAMETERS._replace(road=RoadParameters(*roads[0].tolist()))
    car = OwnCar(at_start)
    stepped = [car.reset(22.0)]
    for control, row in zip(inputs, roads.tolist(), strict=True):
        car.set_road(RoadAt(0.0, 0.0, *row))
        stepped.append(car.step(control, PERIOD_S)[-1].copy())
    motion, _ = simulate(settle(22.0, at_start), np.array(inputs), at_start, roads=roads)
    np.testing.assert_array_equal(np.array(stepped), motion[::STEPS_PER_PERIOD])
    on_flat, _ = simulate(settle(22.0, at_start), np.array(inputs), at_start)
    assert np.abs(motion - on_flat).max() > 0.05


def test_runs_after_a_reset_are_equal_and_other_cars_do_not_move() -> None:
    inputs = wandering_inputs(30)
    car, other = Car(OwnCar(PARAMETERS), 25.0), Car(OwnCar(PARAMETERS), 25.0)
    before = other.plant.outputs()
    first = [car.advance(control, 0.0) for control in inputs]
    assert other.plant.outputs() == before
    assert sum(state.ds_m for state in first) == pytest.approx(car.s_m)
    assert car.reset(25.0) == (25.0, 0.0, 0.0, 25.0 * 0.025, 0.0, 0.0)
    assert [car.advance(control, 0.0) for control in inputs] == first


def test_outputs_belong_to_the_current_state() -> None:
    car = Car(OwnCar(PARAMETERS), 25.0)
    for _ in range(40):
        state = car.advance(ControlInput(0.2, 0.0, np.radians(20.0)), 0.0)
    outputs = car.plant.outputs()
    assert outputs.ay_mps2 == pytest.approx(state.yaw_rate_radps * state.vx_mps, rel=0.05)
    assert outputs.roll_rad > 0.0
    assert outputs.throttle == pytest.approx(0.2, abs=0.01)
    assert outputs.gear == 6.0
    assert outputs == car.plant.outputs()
