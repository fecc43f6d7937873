"""Ratios and lags between signals tell wrong units and delays of a log."""

import re

import numpy as np
import pytest
from made_logs import MAPPING, POSE, episode_of, make_drive

from offline.logs.relations import compare_signals
from rt_controller.mapping.relations import check_relations, relations_of

DT_S = 0.02
SECOND = """
[checks.signals]
gps_mps = { column = "gps", unit = "m/s", quantity = "speed" }
ax_mps2 = { column = "ax", unit = "m/s^2" }
ay_mps2 = { column = "ay", unit = "g" }
"""
SAME_SLOT = MAPPING.replace('road_wheel_rad = { column = "wheel"', 'steer_rad = { column = "wheel"')
WITHOUT_SPEED = """
[states]
yaw_rate_radps = { column = "turn", unit = "rad/s" }
[inputs]
force_n = { column = "force", unit = "N" }
"""


def episode(file="a.csv", seed=0, **factors):
    """The made drive, columns of its log multiplied, and the second records in SI."""
    made = make_drive(40.0, DT_S, seed)
    own = episode_of(
        made._replace(**{name: getattr(made, name) * by for name, by in factors.items()}), file
    )
    own.signals["steer_rad"] = 15.0 * own.signals["road_wheel_rad"]
    own.signals["gps_mps"] = made.speed
    own.signals["ax_mps2"] = made.force / 1500.0
    own.signals["ay_mps2"] = made.speed * made.turn
    return own


def late(by_s, column):
    made, steps = make_drive(60.0, DT_S), round(by_s / DT_S)
    values = getattr(made, column)
    values = np.concatenate([np.full(steps, values[0]), values[: len(values) - steps]])
    return episode_of(made._replace(**{column: values}))


def issues_of(parse, episodes, text):
    return compare_signals(episodes, parse(f"period_s = {DT_S}\n{text}"))[1]


@pytest.mark.parametrize(
    ("text", "episodes", "subject", "words"),
    [
        (MAPPING, [{}, {"speed": 3.6}, {}], "b.csv", "km/h taken for m/s"),
        (MAPPING, [{}, {"turn": 57.3}, {}], "b.csv", "degrees"),
        (MAPPING, [{}, {"force": 1e-3}, {}], "b.csv", "thousand"),
        (MAPPING, [{}, {"speed": 3.6}], "a.csv", "km/h"),
        (MAPPING, [{}, {"wheel": -1.0}, {}], "b.csv", "a wrong sign"),
        (MAPPING + POSE, [{"speed": 3.6}], "a.csv", "speed of the pose = v_x: .*km/h"),
        (MAPPING + POSE, [{"turn": 57.3}], "a.csv", "slope of pose.yaw = yaw rate: .*degrees"),
        (MAPPING + POSE, [{"turn": -1.0}], "a.csv", "slope of pose.yaw = yaw rate: .*a wrong sign"),
        (MAPPING + POSE, [{"speed": 2.0}], "a.csv", "2 times as expected"),
        (MAPPING + SECOND, [{"speed": 3.6}], "a.csv", "slope of vx_mps over ax_mps2: .*km/h"),
        (MAPPING + SECOND, [{"turn": -1.0}], "a.csv", "vx_mps times yaw_rate_radps .*wrong sign"),
        (SAME_SLOT, [{"wheel": -1.0}], "a.csv", "inputs.steer_rad = .*a wrong sign"),
        (MAPPING + POSE + SECOND, [{}, {}, {}], None, None),
        (SAME_SLOT + POSE, [{}], None, None),
        (MAPPING, [{"wheel": 15.0}], None, None),
        (MAPPING, [{"speed": 0.1}], None, None),
        (WITHOUT_SPEED, [{}], None, None),
    ],
)
def test_a_unit_that_differs_between_logs_or_from_a_second_record_is_an_issue(
    parse, text, episodes, subject, words
):
    made = [episode(f"{'abc'[k]}.csv", k, **factors) for k, factors in enumerate(episodes)]
    issues = [each for each in issues_of(parse, made, text) if each.check != "time shift"]
    if subject is None:
        assert issues == []
    else:
        assert any(each.subject == subject and re.search(words, each.message) for each in issues)
        assert all(each.subject != "c.csv" for each in issues)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_brake_counts_with_its_sign_reversed(parse, sign):
    text = MAPPING.replace("force_n", "brake_pa").replace('"N"', '"Pa"')
    one = episode()
    one.signals["brake_pa"] = sign * late(0.7, "force").signals["force_n"][: len(one)]
    assert bool(issues_of(parse, [one], text)) is (sign < 0.0)


@pytest.mark.parametrize(
    ("one", "text", "subject", "words"),
    [
        (late(0.0, "turn"), MAPPING, None, None),
        (late(0.32, "turn"), MAPPING, "yaw_rate_radps", "delay_s, about 0.3"),
        (late(0.32, "turn"), MAPPING + POSE, "yaw_rate_radps", "delay_s, about 0.3"),
        (late(0.4, "wheel"), MAPPING, "road_wheel_rad", "ahead of road_wheel_rad"),
    ],
)
def test_a_delay_of_the_log_is_an_issue_and_the_lag_of_the_car_is_not(
    parse, one, text, subject, words
):
    issues = [each for each in issues_of(parse, [one], text) if each.check == "time shift"]
    assert {each.subject for each in issues} == ({subject} if subject else set())
    assert not subject or any(words in each.message for each in issues)


@pytest.mark.parametrize("factors", [{}, {"turn": -1.0}, {"wheel": 0.1}, {"speed": 3.6}])
def test_the_import_and_signals_check_give_the_same_verdict(parse, factors):
    one = episode(**factors)
    answers, _ = compare_signals([one], parse(f"period_s = {DT_S}\n{SAME_SLOT}{POSE}"))
    names = {f"states.{name}": name for name in ("vx_mps", "vy_mps", "yaw_rate_radps")}
    names |= {"inputs.steer_rad": "steer_rad"}
    values = {slot: one.signals[name] for slot, name in names.items()}
    values |= dict(zip(("pose.x", "pose.y", "pose.yaw"), one.pose.T, strict=True))
    t_s = DT_S * np.arange(len(one))
    tracks = {slot: list(zip(t_s, column, strict=True)) for slot, column in values.items()}
    expected = check_relations(tracks, relations_of(None))
    assert {text: answers["a.csv"][text] for text in expected} == {
        text: found.answer for text, found in expected.items()
    }
    assert any(found.is_contradicted for found in expected.values()) is bool(factors)


def test_unrelated_signals_give_no_issue(parse):
    one = episode()
    one.signals["road_wheel_rad"] = np.random.default_rng(0).normal(size=len(one))
    assert issues_of(parse, [one], MAPPING) == []
