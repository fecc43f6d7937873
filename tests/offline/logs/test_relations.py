"""Ratios and lags between signals tell wrong units, delays of a log, and what is not checked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_logs import MAPPING, POSE, episode_of, make_drive

from offline.logs.relations import (
    correlate,
    find_relations,
    find_unchecked,
    time_shift_issues,
    unit_issues,
)

DT_S = 0.02
SECOND = """
[checks.signals]
gps_mps = { column = "gps", unit = "m/s", quantity = "speed" }
ax_mps2 = { column = "ax", unit = "m/s^2" }
ay_mps2 = { column = "ay", unit = "g" }
"""
PEDALS = """
[states]
vx_mps = { column = "speed", unit = "m/s" }
[inputs]
throttle = { column = "force", unit = "%" }
brake_pa = { column = "side", unit = "bar" }
"""

WITHOUT_SPEED = """
[states]
angle_rad = { column = "turn", unit = "rad" }
[inputs]
force_n = { column = "force", unit = "N" }
"""


def episode(file="a.csv", seed=0, **factors):
    """The made drive, columns of its log multiplied, and the second records in SI."""
    made = make_drive(40.0, DT_S, seed)
    own = episode_of(
        made._replace(**{name: getattr(made, name) * by for name, by in factors.items()}), file
    )
    own.signals["gps_mps"] = made.speed
    own.signals["ax_mps2"] = made.force / 1500.0
    own.signals["ay_mps2"] = made.speed * made.turn
    return own


def late(by_s, column):
    made, steps = make_drive(60.0, DT_S), round(by_s / DT_S)
    values = getattr(made, column)
    values = np.concatenate([np.full(steps, values[0]), values[: len(values) - steps]])
    return episode_of(made._replace(**{column: values}))


def relations(parse, episodes, text):
    return find_relations(episodes, parse(f"period_s = {DT_S}\n{text}"))


@pytest.mark.parametrize(
    ("text", "episodes", "subject", "words"),
    [
        (MAPPING, [{}, {"speed": 3.6}, {}], "b.csv", "km/h taken for m/s"),
        (MAPPING, [{}, {"turn": 57.3}, {}], "b.csv", "degrees"),
        (MAPPING, [{}, {"force": 1e-3}, {}], "b.csv", "thousand"),
        (MAPPING, [{}, {"speed": 3.6}], "a.csv", "km/h"),
        (MAPPING, [{}, {"wheel": -1.0}, {}], "b.csv", "a wrong sign"),
        (MAPPING + POSE, [{"speed": 3.6}], "vx_mps", "km/h taken for m/s"),
        (MAPPING + POSE, [{"turn": 57.3}], "yaw_rate_radps", "degrees"),
        (MAPPING + POSE, [{"turn": -1.0}], "yaw_rate_radps", "a wrong sign"),
        (MAPPING + POSE, [{"speed": 2.0}], "vx_mps", "another clock or period"),
        (MAPPING + SECOND, [{"speed": 3.6}], "slope of vx_mps", "km/h"),
        (MAPPING + SECOND, [{"turn": -1.0}], "vx_mps times yaw_rate_radps", "a wrong sign"),
        (MAPPING + POSE + SECOND, [{}, {}, {}], None, None),
        (MAPPING, [{"wheel": 15.0}], None, None),
        (MAPPING, [{"speed": 0.1}], None, None),
        (WITHOUT_SPEED, [{}], None, None),
    ],
)
def test_a_unit_that_differs_between_logs_or_from_a_second_record_is_an_issue(
    parse, text, episodes, subject, words
):
    made = [episode(f"{'abc'[k]}.csv", k, **factors) for k, factors in enumerate(episodes)]
    issues = list(unit_issues(relations(parse, made, text)[0]))
    if subject is None:
        assert issues == []
    else:
        assert any(each.subject == subject and words in each.message for each in issues)
        assert all(each.subject != "c.csv" for each in issues)


def test_a_brake_counts_with_its_sign_reversed(parse):
    one = episode()
    one.signals["throttle"], one.signals["brake_pa"] = one.signals["force_n"], -one.signals.force_n
    ratios, _ = relations(parse, [one], PEDALS)
    drive, brake = (each["slope"] for each in ratios)
    assert drive == pytest.approx(1 / 1500, rel=0.05)
    assert brake == drive


@settings(deadline=None, max_examples=10)
@given(lag_s=st.floats(-0.5, 0.5))
def test_a_lag_is_measured_to_a_fraction_of_a_period(lag_s):
    t = 0.025 * np.arange(4000)
    tones = [(0.2, 0.0), (0.53, 1.0), (0.9, 2.0)]
    cause = sum(np.sin(2 * np.pi * f * t + p) for f, p in tones)
    response = 3.0 - 2.0 * sum(-np.sin(2 * np.pi * f * (t - lag_s) + p) for f, p in tones)
    found_s, correlation = correlate([cause], [response], 0.025)
    assert found_s == pytest.approx(lag_s, abs=2e-3)
    assert correlation > 0.999


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
    _, lags = relations(parse, [one], text)
    issues = list(time_shift_issues(lags))
    assert {each.subject for each in issues} == ({subject} if subject else set())
    assert not subject or any(words in each.message for each in issues)


def test_unrelated_signals_give_no_lag(parse):
    one = episode()
    one.signals["road_wheel_rad"] = np.random.default_rng(0).normal(size=len(one))
    _, lags = relations(parse, [one], MAPPING)
    assert [each["cause"] for each in lags] == ["force_n"]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (MAPPING, ["vx_mps", "vy_mps", "yaw_rate_radps", "road_wheel_rad", "force_n"]),
        (MAPPING + POSE, ["vy_mps", "road_wheel_rad", "force_n"]),
    ],
)
def test_what_no_second_record_confirms_is_named_with_its_range(parse, text, names):
    one = episode()
    ranges = [
        {"name": name, "unit": "in", "lowest": values.min(), "highest": values.max()}
        for name, values in one.signals.items()
    ]
    ratios, _ = relations(parse, [one], text)
    found = find_unchecked(parse(text), ratios, ranges)
    assert [each.split()[2] for each in found] == names
    assert found[-1] == "unit of force_n (-1854 to 1821 in)"
    found = find_unchecked(
        parse(text.replace('column = "time"', "period_s = 0.02")), ratios, ranges
    )
    assert (found[0] == "period of the rows") is ("vx_mps" in names)
