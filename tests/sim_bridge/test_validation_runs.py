"""The manoeuvres of the acceptance tests: what is driven, before anything is measured."""

import numpy as np
import pytest

from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.validation import dwell
from sim_bridge.validation.cars import ALL_WHEEL
from sim_bridge.validation.drivers import OpenLoopDriver, SpeedHold
from sim_bridge.validation.preview import PERIOD_S, Familiarity, PreviewDriver, get_familiar
from sim_bridge.validation.run import Array, Moment, Run, cruising_throttle, drive, replay

CAR = load_parameters(ALL_WHEEL)
SPEED_MPS = 80.0 / 3.6


def test_a_drive_and_the_replay_of_its_inputs_are_the_same_run() -> None:
    def driver(now: Moment) -> ControlInput:
        return ControlInput(0.2, 0.0, 0.5 * float(np.sin(2.0 * now.time_s)))

    driven = drive(CAR, SPEED_MPS, driver, 2.0)
    again = replay(CAR, SPEED_MPS, driven.inputs[1:], driven.period_s)
    np.testing.assert_allclose(again.motion, driven.motion, atol=1e-12)
    np.testing.assert_allclose(again.pose, driven.pose, atol=1e-12)
    np.testing.assert_allclose(again.monitor[1:], driven.monitor[1:], rtol=1e-9, atol=1e-9)


def test_a_run_tells_its_columns_by_name() -> None:
    run = replay(CAR, SPEED_MPS, np.tile((0.15, 0.0, 0.3), (200, 1)), 0.01)
    assert run.time_s[-1] == pytest.approx(2.0)
    assert run.steer_deg[-1] == pytest.approx(np.degrees(0.3))
    assert run.steer_deg[0] == 0.0
    assert run.lateral_g[-1] > 0.1
    assert run.loads_n[-1, 1] > run.loads_n[-1, 0]
    assert run.pose[-1, 1] > 1.0


def test_the_cruising_throttle_holds_the_speed() -> None:
    throttle = cruising_throttle(CAR, SPEED_MPS)
    run = replay(CAR, SPEED_MPS, np.tile((throttle, 0.0, 0.0), (500, 1)), 0.01)
    np.testing.assert_allclose(run.speed_mps, SPEED_MPS, atol=0.2)


def test_the_foot_holds_the_speed_in_a_tightening_turn() -> None:
    foot = SpeedHold(SPEED_MPS, cruising_throttle(CAR, SPEED_MPS), 0.025)
    run = drive(CAR, SPEED_MPS, OpenLoopDriver(lambda time_s: 0.06 * time_s, foot), 12.0, 0.025)
    assert run.lateral_g[-1] > 0.3
    np.testing.assert_allclose(run.speed_mps, SPEED_MPS, atol=0.1)


def test_a_sine_with_dwell_rests_in_its_second_peak() -> None:
    time_s = np.arange(-0.5, 3.0, 0.005)
    wave = dwell.sine_with_dwell(time_s)
    end_s = 1.0 / 0.7 + 0.5
    assert np.all(wave[(time_s < 0.0) | (time_s > end_s)] == 0.0)
    assert wave.max() == pytest.approx(1.0, abs=1e-3)
    resting = (time_s >= 0.75 / 0.7) & (time_s <= 0.75 / 0.7 + 0.5)
    np.testing.assert_allclose(wave[resting], -1.0)
    assert peak_step(wave) < 2.0 * np.pi * 0.7 * 0.005 * 1.01


def peak_step(wave: Array) -> float:
    return float(np.max(np.abs(np.diff(wave))))


@pytest.fixture(scope="module")
def familiarity() -> Familiarity:
    return get_familiar(CAR, SPEED_MPS)


def test_the_driver_s_car_answers_a_gentle_step_as_the_plant_does(
    familiarity: Familiarity,
) -> None:
    steer_rad = np.radians(5.0)
    held = (familiarity.throttle, 0.0, steer_rad)
    run = replay(CAR, SPEED_MPS, np.tile(held, (300, 1)), PERIOD_S)
    expected = np.zeros(2)
    for _ in range(300):
        expected = familiarity.free @ expected + familiarity.forced * steer_rad
    assert run.motion[-1, 2] == pytest.approx(expected[1], rel=0.05)


def lane_change(familiarity: Familiarity, preview_s: float) -> Run:
    def path_m(x_m: Array) -> Array:
        return np.clip((x_m - 40.0) / 50.0, 0.0, 1.0) * 3.5

    driver = PreviewDriver(path_m, preview_s, familiarity)
    return drive(CAR, SPEED_MPS, driver, 7.0, PERIOD_S)


def test_the_preview_driver_changes_the_lane_and_stays_in_it(familiarity: Familiarity) -> None:
    run = lane_change(familiarity, 1.0)
    assert run.pose[-1, 1] == pytest.approx(3.5, abs=0.05)
    assert run.pose[-1, 2] == pytest.approx(0.0, abs=0.01)
    assert run.pose[:, 1].max() < 4.0


def test_the_preview_driver_begins_before_the_bend_by_his_preview(
    familiarity: Familiarity,
) -> None:
    """Nothing to see, nothing to do: he steers from 40 m minus the way of his preview on."""
    for preview_s in (0.6, 1.0):
        run = lane_change(familiarity, preview_s)
        begun = np.abs(run.steer_deg) > 0.5
        first_m = run.pose[int(np.argmax(begun)), 0]
        assert 40.0 - SPEED_MPS * preview_s < first_m < 40.0
