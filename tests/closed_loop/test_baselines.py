"""The fitted bicycle predicts a drive, and each baseline follows a path with it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.figures.closed_loop import ROWS, scenario_of
from rt_controller import Observation, simulate
from rt_controller.baselines.bicycle import Bicycle
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.controllers import BASELINES, open_law

STATE = VehicleState(22.0, -0.05, 0.06, 0.55, 0.2, 0.02)
PATH = PathReference(0.0, 0.0, 0.0, 0.0, 22.0, 0.0)
PREVIOUS = ControlInput(0.15, 0.0, 0.0)


def test_the_derivatives_of_the_bicycle_are_those_of_its_prediction():
    bicycle, rng = Bicycle(), np.random.default_rng(0)
    inputs = np.array([0.2, 10.0, 0.3]) * rng.uniform(0.5, 1.0, (4, 3))
    states = bicycle.predict(STATE, inputs, 0.002)
    found = bicycle.derivatives(states[:-1], inputs, 0.002)
    for column, change in ((0, 1e-4), (1, 1e-5), (2, 1e-5), (4, 1e-4), (5, 1e-5)):
        for k, state in enumerate(states[:-1]):
            state[column] += change
            after = bicycle.predict(state, inputs[k : k + 1], 0.002)[1]
            state[column] -= change
            np.testing.assert_allclose(
                (after - states[k + 1]) / change, found[k, :, column], atol=1e-3
            )


def test_many_cars_move_as_one_does():
    bicycle = Bicycle()
    many = bicycle.step(np.array([STATE, STATE._replace(vx_mps=30.0)]), PREVIOUS, 0.002)
    one = bicycle.predict(STATE, np.array([PREVIOUS]), 0.002)[1]
    np.testing.assert_allclose(many[0], one, rtol=1e-12)


@pytest.mark.parametrize("name", BASELINES)
def test_a_baseline_steers_back_to_its_path(name):
    law = open_law(name)
    straight = CurvaturePreview(5.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(3):
        found = law.control(Observation(STATE, 0.0, PATH, straight, PREVIOUS, (PREVIOUS,) * 2))
    assert found.steer_rad < 0.0
    assert 0.0 < found.throttle < 1.0
    assert found.brake_n == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", BASELINES)
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_baseline_drives_a_bend_beyond_the_usual_wheel_to_its_end(name, side):
    bend = scenario_of(next(row for row in ROWS if f"20 m to the {side}" in row.name))
    drive = simulate(replace(bend, duration_s=8.0), controller=name)
    assert drive.stop_s is None
    assert drive.errors.ey_peak_m < 0.1
    assert np.degrees(np.abs(drive["steer_rad"])).max() > 100.0
