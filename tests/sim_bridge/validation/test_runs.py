"""The runs and drivers of the acceptance tests, and their behaviour without a measurement."""

import numpy as np
import pytest

from rt_controller.contract.errors import PlantError
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import default_car
from sim_bridge.validation.driver_model import (
    DRIVER_PERIOD_S,
    DriverModel,
    PreviewDriver,
    fit_driver_model,
    steer_open_loop,
)
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


def test_speed_control_keeps_the_speed_in_a_tightening_turn() -> None:
    run = steer_open_loop(CAR, SPEED_MPS, lambda time_s: 0.06 * time_s, 12.0, 0.025)
    assert run.lateral_g[-1] > 0.3
    np.testing.assert_allclose(run.speed_mps, SPEED_MPS, atol=0.1)


@pytest.fixture(scope="module")
def model() -> DriverModel:
    return fit_driver_model(CAR, SPEED_MPS)


def test_the_driver_model_has_the_response_of_the_plant_to_a_small_step(
    model: DriverModel,
) -> None:
    steer_rad = np.radians(5.0)
    held = (model.throttle, 0.0, steer_rad)
    run = replay(CAR, SPEED_MPS, np.tile(held, (300, 1)), DRIVER_PERIOD_S)
    expected = np.zeros(2)
    for _ in range(300):
        expected = model.A @ expected + model.b * steer_rad
    assert run.motion[-1, 2] == pytest.approx(expected[1], rel=0.05)


@pytest.mark.parametrize("preview_s", [0.6, 1.0])
def test_the_preview_driver_changes_the_lane_and_begins_within_its_preview(
    model: DriverModel, preview_s: float
) -> None:
    """It steers from 40 m minus the distance of its preview time, and stays in the new lane."""
    driver = PreviewDriver(
        lambda x_m: np.clip((x_m - 40.0) / 50.0, 0.0, 1.0) * 3.5, preview_s, model
    )
    run = run_driver(CAR, SPEED_MPS, driver, 7.0, DRIVER_PERIOD_S)
    assert run.y_m[-1] == pytest.approx(3.5, abs=0.05)
    assert run.pose[-1, 2] == pytest.approx(0.0, abs=0.01)
    assert run.y_m.max() < 4.0
    first_m = run.x_m[int(np.argmax(np.abs(run.steer_deg) > 0.5))]
    assert 40.0 - SPEED_MPS * preview_s < first_m < 40.0
