"""Which signals have to fit each other."""

from pathlib import Path

import numpy as np
import pytest
from made_logs import MAPPING, POSE, make_drive, schema_of

from offline.logs.episode import Episode
from offline.logs.pair import Tie, find_pairs, slope

DT_S = 0.02
PEDALS = """
[states]
vx_mps = { column = "speed", unit = "m/s" }
[inputs]
throttle = { column = "force", unit = "%" }
brake_pa = { column = "side", unit = "bar" }
"""


def pairs_of(parse, text):
    mapping = parse(text)
    made = make_drive(10.0, DT_S)
    x = np.stack([made.speed, made.side, made.turn], axis=1)[:, : len(mapping.states)]
    u = np.stack([made.wheel, made.force], axis=1)
    pose = np.stack([made.x, made.y, made.yaw], axis=1)
    schema = schema_of(mapping, DT_S)
    return find_pairs([Episode(Path("a"), 0.0, x, u, np.zeros((len(x), 0)), pose)], mapping, schema)


def test_a_car_without_pose_is_told_by_its_steering_and_its_force(parse):
    found = {(pair.cause, pair.response): pair.tie for pair in pairs_of(parse, MAPPING)}
    assert found == {
        ("road_wheel_rad", "yaw_rate_radps"): Tie.STEERED,
        ("force_n", "slope of vx_mps"): Tie.PEDALLED,
    }


def test_a_pose_says_the_same_as_speed_and_yaw_rate(parse):
    same = [pair for pair in pairs_of(parse, MAPPING + POSE) if pair.tie is Tie.SAME]
    assert {pair.response for pair in same} == {"yaw_rate_radps", "vx_mps"}
    for pair in same:
        np.testing.assert_allclose(pair.causes[0][5:-5], pair.responses[0][5:-5], atol=0.05)


def test_a_brake_is_a_pedal_that_works_backwards(parse):
    drive, brake = pairs_of(parse, PEDALS)
    made = make_drive(10.0, DT_S)
    assert (drive.cause, brake.cause) == ("throttle", "brake_pa")
    np.testing.assert_array_equal(drive.causes[0], made.wheel)
    np.testing.assert_array_equal(brake.causes[0], -made.force)


def test_a_slope_is_that_of_a_line_and_is_not_shifted():
    t = 0.025 * np.arange(100)
    assert slope(3.0 * t, 0.025) == pytest.approx(np.full(100, 3.0))
    assert slope(t**2, 0.025)[50] == pytest.approx(2 * t[50])
