"""What nothing in the logs confirms is named."""

import pytest
from made_logs import (
    MAPPING,
    POSE,
    episode_of,
    make_drive,
    make_drive_of_many_speeds,
    make_sliding_drive,
)

from offline.logs.checks.evidence import find_unchecked
from offline.logs.checks.motion import check_motion
from offline.logs.checks.unit_check import find_proportions

ROWS_ONLY = MAPPING.replace('column = "time"', "period_s = 0.02")
STEERING_WHEEL = MAPPING.replace("road_wheel_rad", "steer_rad")
CAR = "[car]\nwheelbase_m = 2.7\nrear_axle_m = 1.4\nsteering_ratio = 1.0\n"


def unchecked(parse, text, made=None):
    episode = episode_of(made or make_drive(40.0, 0.02))
    episode.signals["steer_rad"] = episode.signals["road_wheel_rad"]
    mapping = parse("period_s = 0.02\n" + text)
    proportions = find_proportions([episode], mapping)
    return find_unchecked(mapping, proportions, check_motion([episode], mapping)[0])


def test_the_geometry_of_road_wheels_confirms_speed_yaw_rate_and_angle(parse):
    found = unchecked(parse, MAPPING, make_drive_of_many_speeds())
    assert found == ("unit of vy_mps", "unit of force_n")


def test_a_drive_of_one_speed_leaves_the_geometry_open(parse):
    assert "unit of vx_mps" in unchecked(parse, MAPPING)


def test_rows_without_time_leave_the_period_open(parse):
    assert unchecked(parse, ROWS_ONLY)[0] == "period of the rows"
    assert "period of the rows" not in unchecked(parse, ROWS_ONLY + POSE)
    sliding = make_sliding_drive(dt_s=0.02)
    assert "period of the rows" not in unchecked(parse, ROWS_ONLY, sliding)


@pytest.mark.parametrize(("extra", "is_open"), [("", True), (CAR, False)])
def test_the_angle_of_a_steering_wheel_confirms_only_with_the_car(parse, extra, is_open):
    found = unchecked(parse, STEERING_WHEEL + extra, make_drive_of_many_speeds())
    assert ("unit of vx_mps" in found) is is_open
    assert ("unit of steer_rad" in found) is is_open


def test_the_pose_confirms_speed_and_yaw_rate(parse):
    found = unchecked(parse, STEERING_WHEEL + POSE)
    assert found == ("unit of vy_mps", "unit of steer_rad", "unit of force_n")
