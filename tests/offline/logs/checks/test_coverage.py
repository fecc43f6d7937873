"""Ranges of signals, and the joint histogram of two."""

import numpy as np
import pandas as pd
import pytest
from made_logs import MAPPING

from offline.logs.checks.samples import BINS, find_occupancy, find_ranges
from offline.logs.episode import LogEpisode
from rt_controller.contract.signals import Schema, Signal


@pytest.fixture
def episodes():
    """Straight on at low speed, turning at high speed; in two episodes."""
    signals = pd.DataFrame(
        {
            "vx_mps": np.linspace(10.0, 26.0, 801),
            "vy_mps": np.zeros(801),
            "yaw_rate_radps": np.where(np.arange(801) < 400, 0.0, 0.5),
            "road_wheel_rad": np.linspace(-0.1, 0.3, 801),
            "force_n": np.zeros(801),
        }
    )
    halves = (signals[:300], signals[300:])
    return [LogEpisode("a.csv", 0.0, half, np.zeros((len(half), 0))) for half in halves]


def test_ranges_are_over_all_episodes(episodes):
    schema = Schema((Signal("vx_mps", "m/s"),), (Signal("road_wheel_rad", "rad"),), (), 0.025)
    speed, wheel = find_ranges(episodes, schema)
    numbers = (speed.lowest, speed.q05, speed.median, speed.q95, speed.highest)
    assert numbers == pytest.approx((10.0, 10.8, 18.0, 25.2, 26.0))
    assert (wheel.lowest, wheel.highest) == pytest.approx((-0.1, 0.3))


def test_the_histogram_is_of_speed_and_lateral_acceleration(parse, episodes):
    occupancy = find_occupancy(episodes, parse())
    assert "lateral acceleration" in occupancy.across
    share = np.array(occupancy.share)
    assert share.sum() == pytest.approx(1.0)
    assert occupancy.across_edges[-1] == pytest.approx(13.0)
    # Slow turns and fast straights do not occur.
    assert share[0, -1] == share[-1, 0] == 0.0
    assert share[:4, 0].sum() == pytest.approx(400 / 801, abs=0.01)
    assert occupancy.filled == np.count_nonzero(share) / BINS**2


def test_without_a_yaw_rate_the_histogram_is_of_speed_and_steering(parse, episodes):
    text = "\n".join(line for line in MAPPING.splitlines() if "yaw_rate" not in line)
    assert find_occupancy(episodes, parse(text)).across == "road_wheel_rad, rad"


def test_without_a_speed_there_is_no_histogram(parse, episodes):
    mapping = parse(MAPPING.replace("vx_mps", "nothing_m").replace('"m/s" }', '"m" }', 1))
    assert find_occupancy(episodes, mapping) is None
