"""Replay of recorded drives: a car against itself, late sensors, another car, a spin."""

import numpy as np
import pytest

from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import default_car, with_road_friction
from sim_bridge.validation.driver_model import SpeedControl
from sim_bridge.validation.recording.recording import Recording, Signal
from sim_bridge.validation.recording.replay import Replay, replay_recording
from sim_bridge.validation.recording.speed_follower import SpeedFollower
from sim_bridge.validation.run import Observation, Run, cruising_throttle, run_driver

CAR = default_car()
SPEED_MPS = 22.0
EVERY = np.ones(1500, dtype=bool)


def steer_rad(time_s: float) -> float:
    return 0.5 * float(np.sin(2.0 * time_s) + 0.4 * np.sin(5.0 * time_s))


@pytest.fixture(scope="module")
def drive() -> Run:
    """The shipped car at a varying speed."""
    speed = SpeedControl(SPEED_MPS, cruising_throttle(CAR, SPEED_MPS), 0.01)

    def driver(now: Observation) -> ControlInput:
        is_braking = 6.0 < now.time_s < 7.5
        middle_s = now.time_s + 0.005  # the wheel turns on within a period
        throttle = speed.throttle(now.vx_mps + 2.0 * float(np.sin(0.5 * now.time_s)))
        return ControlInput(
            0.0 if is_braking else throttle, 40.0 if is_braking else 0.0, steer_rad(middle_s)
        )

    return run_driver(CAR, SPEED_MPS, driver, 16.0, 0.01)


def recording_of(drive: Run, delay: int = 0) -> Recording:
    """The drive as if it had been recorded; the sensors report `delay` samples late."""
    n = len(drive.time_s) - delay
    steer = np.array([steer_rad(time_s) for time_s in drive.time_s.tolist()])
    sensors = (
        Signal("yaw_rate_radps", drive.motion[:n, 2]),
        Signal("vy_mps", drive.motion[:n, 1]),
        Signal("ay_mps2", drive.column("ay_mps2")[:n]),
        Signal("roll_rad", drive.column("roll_rad")[:n]),
    )
    return Recording(
        "a drive", drive.time_s[delay:], drive.speed_mps[delay:], steer[delay:], False, sensors
    )


def errors(replay: Replay) -> list[float]:
    """In percent, of the compared signals without the rate of the speed."""
    return [one.error_percent for one in replay.comparisons[1:]]


def test_a_drive_of_the_car_itself_is_reproduced(drive: Run) -> None:
    replay = replay_recording(CAR, recording_of(drive))
    assert [one.signal for one in replay.comparisons] == [
        "speed_rate_mps2",
        "yaw_rate_radps",
        "vy_mps",
        "ay_mps2",
        "roll_rad",
    ]
    assert replay.spins == 0
    yaw_rate, vy, ay, roll = errors(replay)
    assert max(yaw_rate, ay, roll) < 2.0
    assert vy < 6.0  # small, and sensitive to the pedals, which are not those of the drive
    assert replay.comparisons[0].error_percent < 40.0
    np.testing.assert_allclose([one.lag_s for one in replay.comparisons[1:]], 0.0, atol=0.012)


def test_late_sensors_are_found_as_a_lag(drive: Run) -> None:
    replay = replay_recording(CAR, recording_of(drive, delay=12))
    lags_s = [one.lag_s for one in replay.comparisons[1:]]
    np.testing.assert_allclose(lags_s, 0.12, atol=0.015)
    assert max(one.error_at_lag_percent for one in replay.comparisons[1:]) < 5.0


def test_another_car_has_a_larger_error(drive: Run) -> None:
    body = CAR.body._replace(front_axle_m=1.25, rear_axle_m=1.66, yaw_inertia_kgm2=3500.0)
    other = CAR._replace(body=body)
    assert min(errors(replay_recording(other, recording_of(drive)))[:2]) > 10.0


def test_angles_of_the_road_wheels_are_those_of_the_steering_wheel_over_the_ratio(
    drive: Run,
) -> None:
    recording = recording_of(drive)
    wheels = Recording(
        recording.name,
        recording.time_s,
        recording.speed_mps,
        recording.steer_rad / CAR.steering.ratio,
        True,
        recording.signals,
    )
    assert errors(replay_recording(CAR, wheels)) == pytest.approx(
        errors(replay_recording(CAR, recording))
    )


def test_a_car_that_spins_is_started_again_and_its_start_is_left_out(drive: Run) -> None:
    recording = recording_of(drive)
    hard = Recording(
        recording.name,
        recording.time_s,
        1.6 * recording.speed_mps,
        4.0 * recording.steer_rad,
        False,
        recording.signals,
    )
    replay = replay_recording(with_road_friction(CAR, 0.4), hard)
    assert replay.spins > 0
    assert replay.compared_s <= 16.01 - 2.0 - 2.0
    assert all(np.isfinite(ours.values).all() for _, ours in replay.signals)


def test_the_pedals_of_the_follower_are_never_both_pressed() -> None:
    time_s = 0.01 * np.arange(800)
    follower = SpeedFollower(CAR, 20.0 + 3.0 * np.sin(time_s), 0.01)
    pedals = np.array([follower.pedals(k, 0.0, 2000.0) for k in range(800)])
    assert np.all((pedals[:, 0] == 0.0) | (pedals[:, 1] == 0.0))
    assert pedals[:, 0].max() <= 1.0
    assert pedals[:, 1].max() > 20.0
