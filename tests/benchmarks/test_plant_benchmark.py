"""Cost of the plant: one control period, and settling before a run.

One period is meant to cost at most 300 us on one core of a desktop machine.
"""

from math import radians

import numpy as np
import pytest

from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, advance, settle
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.plant.states import AT


@pytest.mark.parametrize("name", shipped_cars())
def test_period_of_driving_through_a_bend(benchmark, name: str) -> None:
    car = load_parameters(name)
    state = settle(22.0, car)
    motion = np.empty((STEPS_PER_PERIOD, 3))
    control = ControlInput(0.15, 0.0, radians(15.0))
    benchmark(advance, state, control, car_record(car), STEPS_PER_PERIOD, STEP_S, motion)
    assert state[AT.yaw_rate_radps] > 0.0


def test_settling_before_a_run(benchmark) -> None:
    car = load_parameters("c_class_150kw_awd")
    state = benchmark(settle, 22.0, car)
    assert state[AT.vx_mps] == 22.0
