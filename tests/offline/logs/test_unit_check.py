"""What signals say of each other gives a mix-up of units away."""

from pathlib import Path

import numpy as np
import pytest
from made_logs import MAPPING, POSE, make_drive, schema_of

from offline.logs.episode import Episode
from offline.logs.unit_check import find_proportions, known_factor, remarks

DT_S = 0.02


def episode(file="a.csv", seed=0, **factors):
    made = make_drive(40.0, DT_S, seed)
    made = made._replace(**{name: getattr(made, name) * by for name, by in factors.items()})
    x = np.stack([made.speed, made.side, made.turn], axis=1)
    u = np.stack([made.wheel, made.force], axis=1)
    pose = np.stack([made.x, made.y, made.yaw], axis=1)
    return Episode(Path(file), 0.0, x, u, np.zeros((len(x), 0)), pose)


def remarks_on(parse, episodes, text=MAPPING):
    mapping = parse(text)
    schema = schema_of(mapping, DT_S)
    return remarks(find_proportions(episodes, mapping, schema), episodes, mapping, schema)


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
def test_known_factors_are_recognised_either_way_round(ratio, words):
    found = known_factor(ratio)
    assert (found and words in found.words) or found is words is None


def test_a_car_in_si_raises_no_suspicion(parse):
    episodes = [episode("a.csv"), episode("b.csv", 1), episode("c.csv", 2)]
    assert remarks_on(parse, episodes, MAPPING + POSE) == []


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [("speed", 3.6, "km/h"), ("turn", 57.3, "degrees"), ("force", 1e-3, "thousand")],
)
def test_one_log_in_other_units_than_the_rest_is_named(parse, column, factor, words):
    odd = episode("b.csv", 1, **{column: factor})
    found = remarks_on(parse, [episode("a.csv"), odd, episode("c.csv", 2)])
    assert any(each.subject == "b.csv" and words in each.says for each in found)
    assert all(each.subject != "c.csv" for each in found)


def test_of_two_logs_that_disagree_one_is_named(parse):
    found = remarks_on(parse, [episode("a.csv"), episode("b.csv", 1, speed=3.6)])
    assert any("km/h" in each.says for each in found)


@pytest.mark.parametrize(
    ("column", "factor", "response", "words"),
    [
        ("speed", 3.6, "vx_mps", "km/h taken for m/s"),
        ("turn", 57.3, "yaw_rate_radps", "degrees"),
        ("turn", -1.0, "yaw_rate_radps", "a wrong sign"),
    ],
)
def test_the_pose_gives_a_wrong_unit_or_sign_away(parse, column, factor, response, words):
    found = remarks_on(parse, [episode(**{column: factor})], MAPPING + POSE)
    assert any(each.subject == response and words in each.says for each in found)


@pytest.mark.parametrize(
    ("column", "factor"), [("turn", 57.3), ("wheel", 180 / np.pi * 15.0), ("wheel", -1.0)]
)
def test_a_wheelbase_that_no_car_has_gives_an_angle_away(parse, column, factor):
    (found, *_) = remarks_on(parse, [episode(**{column: factor})])
    assert "expected a wheelbase" in found.says


def test_the_angle_of_a_steering_wheel_is_as_good_as_that_of_the_road_wheels(parse):
    assert remarks_on(parse, [episode(wheel=15.0)]) == []
