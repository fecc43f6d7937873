"""Where the samples lie, of one signal and of two."""

from pathlib import Path

import numpy as np
import pytest
from made_logs import MAPPING, schema_of

from offline.logs.coverage import BINS, find_occupancy, find_ranges
from offline.logs.episode import Episode


def episodes_and_schema(mapping):
    speed = np.linspace(10.0, 26.0, 801)
    turn = np.where(np.arange(801) < 400, 0.0, 0.5)
    x = np.stack([speed, np.zeros(801), turn], axis=1)[:, : len(mapping.states)]
    u = np.stack([np.linspace(-0.1, 0.3, 801), np.zeros(801)], axis=1)
    schema = schema_of(mapping)
    halves = [slice(0, 300), slice(300, None)]
    nothing = np.zeros((801, 0))
    return [Episode(Path("a.csv"), 0.0, x[h], u[h], nothing[h], nothing[h]) for h in halves], schema


def test_ranges_are_over_all_episodes(parse):
    episodes, schema = episodes_and_schema(parse())
    speed, _, _, wheel, _ = find_ranges(episodes, schema)
    assert speed[2:] == pytest.approx((10.0, 10.8, 18.0, 25.2, 26.0))
    assert (wheel.lowest, wheel.highest) == pytest.approx((-0.1, 0.3))


def test_speed_is_held_against_lateral_acceleration(parse):
    mapping = parse()
    episodes, schema = episodes_and_schema(mapping)
    occupancy = find_occupancy(episodes, mapping, schema)
    assert "lateral acceleration" in occupancy.across
    assert occupancy.share.sum() == pytest.approx(1.0)
    assert occupancy.across_edges[-1] == pytest.approx(13.0)
    # Slowly straight on, fast in bends: the other two corners are empty.
    assert occupancy.share[0, -1] == occupancy.share[-1, 0] == 0.0
    assert occupancy.share[:4, 0].sum() == pytest.approx(400 / 801, abs=0.01)
    assert occupancy.filled == np.count_nonzero(occupancy.share) / BINS**2


def test_without_a_yaw_rate_speed_is_held_against_steering(parse):
    text = "\n".join(line for line in MAPPING.splitlines() if "yaw_rate" not in line)
    mapping = parse(text)
    episodes, schema = episodes_and_schema(mapping)
    assert find_occupancy(episodes, mapping, schema).across == "road_wheel_rad, rad"


def test_without_a_speed_there_is_nothing_to_hold_against(parse):
    mapping = parse(MAPPING.replace("vx_mps", "nothing_m").replace('"m/s" }', '"m" }', 1))
    episodes, schema = episodes_and_schema(mapping)
    assert find_occupancy(episodes, mapping, schema) is None
