"""Delays of the log are found, and the lag of the car itself is not reported."""

import numpy as np
import pytest
from made_logs import MAPPING, POSE, episode_of, make_drive

from offline.logs.checks.pairs import correlate, find_time_shifts, time_shift_issues

DT_S = 0.02


def shifted(values, by_s):
    steps = round(by_s / DT_S)
    return np.concatenate([np.full(steps, values[0]), values])[: len(values)] if steps else values


def episode(late_s=0.0, wheel_late_s=0.0):
    made = make_drive(60.0, DT_S)
    wheel = shifted(made.wheel, wheel_late_s)
    return episode_of(made._replace(turn=shifted(made.turn, late_s), wheel=wheel))


def shifts_of(parse, one, text=MAPPING):
    mapping = parse(f"period_s = {DT_S}\n" + text)
    return {(s.cause, s.response): s for s in find_time_shifts([one], mapping)}


@pytest.mark.parametrize("lag_s", [-0.3, 0.0, 0.32])
def test_a_lag_is_measured_to_a_fraction_of_a_period(lag_s):
    t = 0.025 * np.arange(4000)
    tones = [(0.2, 0.0), (0.53, 1.0), (0.9, 2.0)]
    cause = sum(np.sin(2 * np.pi * f * t + p) for f, p in tones)
    response = 3.0 - 2.0 * sum(-np.sin(2 * np.pi * f * (t - lag_s) + p) for f, p in tones)
    found_s, correlation = correlate([cause], [response], 0.025)
    assert found_s == pytest.approx(lag_s, abs=2e-3)
    assert correlation > 0.999


def test_the_lag_of_the_car_itself_is_not_an_issue(parse):
    shifts = shifts_of(parse, episode())
    steered = shifts["road_wheel_rad", "yaw_rate_radps"]
    assert steered.lag_s == pytest.approx(0.1, abs=0.03)
    assert shifts["force_n", "slope of vx_mps"].lag_s == pytest.approx(0.0, abs=0.03)
    assert not list(time_shift_issues(list(shifts.values())))


def test_a_late_yaw_rate_is_found_from_steering(parse):
    shifts = shifts_of(parse, episode(late_s=0.32))
    steered = shifts["road_wheel_rad", "yaw_rate_radps"]
    assert steered.lag_s == pytest.approx(0.42, abs=0.03)
    (issue,) = time_shift_issues(list(shifts.values()))
    assert issue.subject == "yaw_rate_radps"
    assert "delay_s, about 0.3" in issue.message


def test_the_lag_behind_the_pose_is_the_delay_of_the_log(parse):
    shifts = shifts_of(parse, episode(late_s=0.32), MAPPING + POSE)
    assert shifts["slope of the pose's yaw", "yaw_rate_radps"].lag_s == pytest.approx(
        0.32, abs=0.01
    )
    assert shifts["speed of the pose", "vx_mps"].lag_s == pytest.approx(0.0, abs=0.02)


def test_a_cause_that_follows_its_response_is_reported_as_late(parse):
    shifts = shifts_of(parse, episode(wheel_late_s=0.4))
    (issue,) = time_shift_issues(list(shifts.values()))
    assert issue.subject == "road_wheel_rad"
    assert "ahead of road_wheel_rad" in issue.message


def test_unrelated_signals_give_no_lag(parse):
    one = episode()
    one.signals["road_wheel_rad"] = np.random.default_rng(0).normal(size=len(one))
    assert ("road_wheel_rad", "yaw_rate_radps") not in shifts_of(parse, one)
