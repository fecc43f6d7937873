"""Pairs of signals that depend on each other are found by quantity."""

from dataclasses import replace

import numpy as np
import pytest
from made_logs import MAPPING, POSE, episode_of, make_drive

from offline.logs.checks.pairs import Relation, find_pairs, slope

DT_S = 0.02
PEDALS = """
[states]
vx_mps = { column = "speed", unit = "m/s" }
[inputs]
throttle = { column = "force", unit = "%" }
brake_pa = { column = "side", unit = "bar" }
"""


def pairs_of(parse, text, **renamed):
    episode = episode_of(make_drive(10.0, DT_S))
    episode = replace(episode, signals=episode.signals.rename(columns=renamed))
    return find_pairs([episode], parse(f"period_s = {DT_S}\n" + text))


def test_without_pose_the_pairs_are_steering_and_pedal(parse):
    found = {(pair.cause, pair.response): pair.relation for pair in pairs_of(parse, MAPPING)}
    assert found == {
        ("road_wheel_rad", "yaw_rate_radps"): Relation.STEERING,
        ("force_n", "slope of vx_mps"): Relation.PEDAL,
    }


def test_speed_and_yaw_rate_of_the_pose_equal_the_signals(parse):
    same = [
        pair for pair in pairs_of(parse, MAPPING + POSE) if pair.relation is Relation.SAME_MOTION
    ]
    assert {pair.response for pair in same} == {"yaw_rate_radps", "vx_mps"}
    for pair in same:
        np.testing.assert_allclose(pair.causes[0][5:-5], pair.responses[0][5:-5], atol=0.05)


def test_a_brake_counts_with_its_sign_reversed(parse):
    drive, brake = pairs_of(parse, PEDALS, road_wheel_rad="throttle", force_n="brake_pa")
    made = make_drive(10.0, DT_S)
    assert (drive.cause, brake.cause) == ("throttle", "brake_pa")
    np.testing.assert_array_equal(drive.causes[0], made.wheel)
    np.testing.assert_array_equal(brake.causes[0], -made.force)


def test_the_slope_of_a_line_is_exact_and_not_shifted():
    t = 0.025 * np.arange(100)
    assert slope(3.0 * t, 0.025) == pytest.approx(np.full(100, 3.0))
    assert slope(t**2, 0.025)[50] == pytest.approx(2 * t[50])
