"""What nothing in the logs confirms is named, with its range."""

from made_logs import MAPPING, POSE, episode_of, make_drive

from offline.logs.checks.pairs import find_proportions, find_unchecked
from offline.logs.checks.samples import find_ranges
from rt_controller.contract.signals import Schema, Signal

ROWS_ONLY = MAPPING.replace('column = "time"', "period_s = 0.02")
SCHEMA = Schema(
    (Signal("vx_mps", "m/s"), Signal("vy_mps", "m/s"), Signal("yaw_rate_radps", "rad/s")),
    (Signal("road_wheel_rad", "rad"), Signal("force_n", "N")),
    (),
    0.02,
)


def unchecked(parse, text):
    episode, mapping = episode_of(make_drive(40.0, 0.02)), parse("period_s = 0.02\n" + text)
    ranges = find_ranges([episode], SCHEMA)
    return find_unchecked(mapping, find_proportions([episode], mapping), ranges)


def test_a_log_without_second_measurements_confirms_no_unit(parse):
    found = unchecked(parse, MAPPING)
    assert [each.split()[2] for each in found] == [*MAPPING_SIGNALS]
    assert found[0].startswith("unit of vx_mps (1")
    assert found[0].endswith(" m/s)")


MAPPING_SIGNALS = ("vx_mps", "vy_mps", "yaw_rate_radps", "road_wheel_rad", "force_n")


def test_rows_without_time_leave_the_period_open(parse):
    assert unchecked(parse, ROWS_ONLY)[0] == "period of the rows"
    assert "period of the rows" not in unchecked(parse, ROWS_ONLY + POSE)


def test_the_pose_confirms_speed_and_yaw_rate(parse):
    names = [each.split()[2] for each in unchecked(parse, MAPPING + POSE)]
    assert names == ["vy_mps", "road_wheel_rad", "force_n"]
