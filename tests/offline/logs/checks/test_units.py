"""Wrong units are found from the ratios between signals."""

import numpy as np
import pytest
from made_logs import MAPPING, POSE, episode_of, make_drive

from offline.logs.checks.pairs import find_proportions, unit_issues
from offline.logs.checks.unit_mistakes import find_mistake

DT_S = 0.02


def episode(file="a.csv", seed=0, **factors):
    made = make_drive(40.0, DT_S, seed)
    made = made._replace(**{name: getattr(made, name) * by for name, by in factors.items()})
    return episode_of(made, file)


def issues_of(parse, episodes, text=MAPPING):
    mapping = parse(f"period_s = {DT_S}\n" + text)
    return unit_issues(find_proportions(episodes, mapping), episodes, mapping)


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (3.6, "km/h"),
        (1 / 3.5, "km/h"),
        (57.0, "degrees"),
        (9.5, "g taken"),
        (2.0, None),
        (1.0, None),
        (-3.6, None),
    ],
)
def test_a_known_factor_and_its_inverse_are_recognised(ratio, words):
    found = find_mistake(ratio)
    assert (found and words in found) or found is words is None


def test_signals_in_si_raise_no_issue(parse):
    episodes = [episode("a.csv"), episode("b.csv", 1), episode("c.csv", 2)]
    assert issues_of(parse, episodes, MAPPING + POSE) == []


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [("speed", 3.6, "km/h"), ("turn", 57.3, "degrees"), ("force", 1e-3, "thousand")],
)
def test_a_log_in_other_units_than_the_rest_is_reported(parse, column, factor, words):
    odd = episode("b.csv", 1, **{column: factor})
    found = issues_of(parse, [episode("a.csv"), odd, episode("c.csv", 2)])
    assert any(each.subject == "b.csv" and words in each.message for each in found)
    assert all(each.subject != "c.csv" for each in found)


def test_one_of_two_logs_that_disagree_is_reported(parse):
    found = issues_of(parse, [episode("a.csv"), episode("b.csv", 1, speed=3.6)])
    assert any("km/h" in each.message for each in found)


@pytest.mark.parametrize(
    ("column", "factor", "response", "words"),
    [
        ("speed", 3.6, "vx_mps", "km/h taken for m/s"),
        ("turn", 57.3, "yaw_rate_radps", "degrees"),
        ("turn", -1.0, "yaw_rate_radps", "a wrong sign"),
    ],
)
def test_a_wrong_unit_or_sign_is_found_from_the_pose(parse, column, factor, response, words):
    found = issues_of(parse, [episode(**{column: factor})], MAPPING + POSE)
    assert any(each.subject == response and words in each.message for each in found)


@pytest.mark.parametrize(
    ("column", "factor"), [("turn", 57.3), ("wheel", 180 / np.pi * 15.0), ("wheel", -1.0)]
)
def test_a_wrong_angle_is_found_from_an_impossible_wheelbase(parse, column, factor):
    (found, *_) = issues_of(parse, [episode(**{column: factor})])
    assert "expected a wheelbase" in found.message


@pytest.mark.parametrize("column", ["speed", "turn"])
def test_a_factor_that_is_no_unit_is_found_from_the_pose(parse, column):
    found = issues_of(parse, [episode(**{column: 2.0})], MAPPING + POSE)
    assert any("another clock or period" in each.message for each in found)


SECOND = """
[checks.signals]
gps_mps = { column = "gps", unit = "m/s", quantity = "speed" }
ax_mps2 = { column = "ax", unit = "m/s^2" }
ay_mps2 = { column = "ay", unit = "g" }
"""


def with_second_measurements(**factors):
    made, own = make_drive(40.0, DT_S), episode(**factors)
    own.signals["gps_mps"] = made.speed
    own.signals["ax_mps2"] = made.force / 1500.0
    own.signals["ay_mps2"] = made.speed * made.turn
    return own


def test_second_measurements_that_agree_raise_no_issue(parse):
    assert issues_of(parse, [with_second_measurements()], MAPPING + SECOND) == []


@pytest.mark.parametrize(
    ("column", "factor", "responses"),
    [
        ("speed", 3.6, {"vx_mps", "slope of vx_mps", "vx_mps times yaw_rate_radps"}),
        ("turn", -1.0, {"vx_mps times yaw_rate_radps"}),
    ],
)
def test_a_wrong_unit_is_found_from_second_measurements(parse, column, factor, responses):
    text = MAPPING + SECOND
    found = issues_of(parse, [with_second_measurements(**{column: factor})], text)
    assert responses <= {each.subject for each in found}


def test_the_angle_of_a_steering_wheel_raises_no_issue(parse):
    assert issues_of(parse, [episode(wheel=15.0)]) == []
