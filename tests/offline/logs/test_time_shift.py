"""A log that is late is found out, and a car that takes its time is not blamed."""

from pathlib import Path

import numpy as np
import pytest
from made_logs import MAPPING, POSE, make_drive, schema_of

from offline.logs.episode import Episode
from offline.logs.time_shift import correlate, find_time_shifts, remarks

DT_S = 0.02


def shifted(values, by_s):
    steps = round(by_s / DT_S)
    return np.concatenate([np.full(steps, values[0]), values])[: len(values)] if steps else values


def episode(late_s=0.0, wheel_late_s=0.0):
    made = make_drive(60.0, DT_S)
    turn = shifted(made.turn, late_s)
    wheel = shifted(made.wheel, wheel_late_s)
    x = np.stack([made.speed, made.side, turn], axis=1)
    u = np.stack([wheel, made.force], axis=1)
    pose = np.stack([made.x, made.y, made.yaw], axis=1)
    return Episode(Path("a.csv"), 0.0, x, u, np.zeros((len(x), 0)), pose)


def shifts_of(parse, one, text=MAPPING):
    mapping = parse(text)
    schema = schema_of(mapping, DT_S)
    return {(s.cause, s.response): s for s in find_time_shifts([one], mapping, schema)}


@pytest.mark.parametrize("lag_s", [-0.3, 0.0, 0.32])
def test_a_lag_is_measured_between_the_periods(lag_s):
    t = 0.025 * np.arange(4000)
    tones = [(0.2, 0.0), (0.53, 1.0), (0.9, 2.0)]
    cause = sum(np.sin(2 * np.pi * f * t + p) for f, p in tones)
    response = 3.0 - 2.0 * sum(-np.sin(2 * np.pi * f * (t - lag_s) + p) for f, p in tones)
    found_s, correlation = correlate([cause], [response], 0.025)
    assert found_s == pytest.approx(lag_s, abs=2e-3)
    assert correlation > 0.999


def test_the_lag_of_the_car_itself_is_no_reason_to_remark(parse):
    shifts = shifts_of(parse, episode())
    steered = shifts["road_wheel_rad", "yaw_rate_radps"]
    assert steered.lag_s == pytest.approx(0.1, abs=0.03)
    assert shifts["force_n", "slope of vx_mps"].lag_s == pytest.approx(0.0, abs=0.03)
    assert remarks(list(shifts.values())) == []


def test_a_yaw_rate_that_is_logged_late_is_found_by_steering(parse):
    shifts = shifts_of(parse, episode(late_s=0.32))
    steered = shifts["road_wheel_rad", "yaw_rate_radps"]
    assert steered.lag_s == pytest.approx(0.42, abs=0.03)
    (remark,) = remarks(list(shifts.values()))
    assert remark.subject == "yaw_rate_radps"
    assert "delay_s, about 0.3" in remark.says


def test_against_the_pose_the_lag_is_that_of_the_log_alone(parse):
    shifts = shifts_of(parse, episode(late_s=0.32), MAPPING + POSE)
    assert shifts["slope of the pose's yaw", "yaw_rate_radps"].lag_s == pytest.approx(
        0.32, abs=0.01
    )
    assert shifts["speed of the pose", "vx_mps"].lag_s == pytest.approx(0.0, abs=0.02)


def test_a_cause_after_its_response_is_blamed_itself(parse):
    shifts = shifts_of(parse, episode(wheel_late_s=0.4))
    (remark,) = remarks(list(shifts.values()))
    assert remark.subject == "road_wheel_rad"
    assert "ahead of road_wheel_rad" in remark.says


def test_signals_that_have_nothing_to_do_with_each_other_tell_nothing(parse):
    one = episode()
    one.u[:, 0] = np.random.default_rng(0).normal(size=len(one.u))
    assert ("road_wheel_rad", "yaw_rate_radps") not in shifts_of(parse, one)
