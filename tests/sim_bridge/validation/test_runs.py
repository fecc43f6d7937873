"""The runs and drivers of the acceptance tests, and their behaviour without a measurement."""

import numpy as np
import pytest

from rt_controller.contract.errors import PlantError
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import default_car
from sim_bridge.validation.driver_model import DRIVER_PERIOD_S
from sim_bridge.validation.run import Observation, Run, replay, run_driver

CAR = default_car()
SPEED_MPS = 80.0 / 3.6


def test_the_replay_of_a_drive_s_inputs_equals_the_drive() -> None:
    def driver(now: Observation) -> ControlInput:
        return ControlInput(0.2, 0.0, 0.5 * float(np.sin(2.0 * now.time_s)))

    driven = run_driver(CAR, SPEED_MPS, driver, 2.0, DRIVER_PERIOD_S)
    again = replay(CAR, SPEED_MPS, driven.inputs[1:], driven.period_s)
    np.testing.assert_allclose(again.motion, driven.motion, atol=1e-12)
    np.testing.assert_allclose(again.pose, driven.pose, atol=1e-12)
    np.testing.assert_allclose(again.outputs[1:], driven.outputs[1:], rtol=1e-9, atol=1e-9)


def test_a_car_that_fails_is_refused_with_the_time() -> None:
    motion = np.full((5, 3), 20.0)
    motion[3:] = np.nan
    with pytest.raises(PlantError, match=r"0\.30 s"):
        Run(0.1, np.zeros((5, 3)), motion, np.zeros((5, 3)), np.zeros((5, 28)))
