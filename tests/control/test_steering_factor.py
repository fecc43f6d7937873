"""A car that turns otherwise for an angle of its wheel than the car of the model."""

from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

import sim_bridge
from rt_controller import simulate
from rt_controller.contract.signals import ControlInput
from rt_controller.control.estimator import MOTION_GAIN
from rt_controller.control.steering_factor import LARGEST, SMALLEST, SteeringFactor
from sim_bridge.scenario import load_scenario

CAR = Path(sim_bridge.__file__).parent / "cars" / "c_class_150kw_awd.toml"


@pytest.mark.parametrize("ratio", [15.0, 22.0])
def test_a_car_with_another_steering_ratio_stays_on_its_path(tmp_path, ratio):
    car, text = tmp_path / "car.toml", CAR.read_text()
    assert text.count("ratio = { value = 18.5,") == 1
    car.write_text(text.replace("ratio = { value = 18.5,", f"ratio = {{ value = {ratio},"))
    scenario = replace(load_scenario("double_lane_change"), metrics=("ey_rms_m",), limits={})
    drive = simulate(scenario, car=car)
    assert drive.car_figures[0].value <= 0.010


@pytest.mark.parametrize("of_car", [0.8, 1.0, 1.25])
def test_the_factor_of_a_car_is_found_while_it_turns(of_car):
    factor = SteeringFactor(MOTION_GAIN)
    for k in range(400):
        wheel_radps = 0.2 * np.sin(0.05 * k)
        bank_radps = 0.02
        factor.learn(factor.value * wheel_radps + bank_radps, of_car * wheel_radps)
    assert factor.value == pytest.approx(of_car, rel=0.02)
    assert factor.of_model(ControlInput(0.1, 0.0, 0.5)) == (0.1, 0.0, 0.5 * factor.value)


@pytest.mark.parametrize(
    ("predicted_radps", "measured_radps"),
    [
        pytest.param(0.1, 0.0, id="the wheel compensates a side wind"),
        pytest.param(0.1, 0.1, id="a bend as predicted"),
        pytest.param(0.0, 0.03, id="an offset of the sensor"),
    ],
)
def test_what_is_not_a_gain_of_the_wheel_changes_little(predicted_radps, measured_radps):
    factor = SteeringFactor(MOTION_GAIN)
    for _ in range(400):
        factor.learn(predicted_radps, measured_radps)
    assert factor.value == pytest.approx(1.0, abs=0.05)


def test_a_prediction_with_the_wheel_at_its_largest_rate_is_not_learned_from():
    factor = SteeringFactor(MOTION_GAIN)
    for k in range(400):
        factor.turn(radians(4.9) * (k % 2))
        factor.learn(0.2 * np.sin(0.5 * k), 0.2 * np.sin(0.5 * k - 0.8))
    assert factor.value == 1.0
    for k in range(400):
        factor.turn(0.0)
        wheel_radps = 0.2 * np.sin(0.05 * k)
        factor.learn(factor.value * wheel_radps, 1.2 * wheel_radps)
    assert factor.value == pytest.approx(1.2, rel=0.02)


def test_a_baseline_learns_at_the_largest_rate_of_the_wheel_too():
    factor = SteeringFactor(MOTION_GAIN, learns_at_rate=True)
    for k in range(400):
        factor.turn(radians(4.9) * (k % 2))
        wheel_radps = 0.2 * np.sin(0.05 * k)
        factor.learn(factor.value * wheel_radps, 1.2 * wheel_radps)
    assert factor.value == pytest.approx(1.2, rel=0.02)


def test_noise_of_the_sensor_is_not_learned_on_a_straight_road():
    rng, factor = np.random.default_rng(0), SteeringFactor(MOTION_GAIN)
    for measured_radps in 0.002 * rng.standard_normal(60_000):  # 25 minutes
        factor.learn(0.0, measured_radps)
    assert factor.value == 1.0


def test_no_measurement_leads_the_factor_out_of_its_bounds():
    rng, factor = np.random.default_rng(0), SteeringFactor(MOTION_GAIN)
    for size in (1e-12, 0.3, 50.0, 1e150):
        for _ in range(300):
            factor.learn(*(size * rng.standard_normal(2)).tolist())
            assert SMALLEST <= factor.value <= LARGEST
    for k in range(300):  # a sensor of the yaw rate that shows nine times as much
        yaw_rate_radps = 0.4 * np.sin(0.1 * k)
        factor.learn(yaw_rate_radps, 9.0 * yaw_rate_radps)
    assert factor.value == pytest.approx(LARGEST)
    factor.reset()
    assert factor.value == 1.0
