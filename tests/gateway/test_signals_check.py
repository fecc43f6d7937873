"""What is wrong with a mapping is named with its remedy, from frames alone."""

from math import cos, sin

import pytest
from own_car import EXAMPLE, VALUES, example, state_writer

from rt_controller.gateway.signals_check import check_signals
from rt_controller.mapping.car_file import read_car

YAW_RATE, SPEED = 0.1, 20.0


def frames(ticks=200, without=()):
    """The car in a turn to the left, 25 ms a tick."""
    writer, found = state_writer(example()), []
    for tick in range(ticks):
        time_s = 0.025 * tick
        yaw, radius = YAW_RATE * time_s, SPEED / YAW_RATE
        values = {
            **VALUES,
            "states.yaw_rate_radps": YAW_RATE,
            "inputs.steer_rad": 0.36,
            "pose.x": radius * sin(yaw),
            "pose.y": radius * (1.0 - cos(yaw)),
            "pose.yaw": yaw,
        }
        found += [
            (time_s, frame)
            for frame in writer.frames(values, tick)
            if frame.arbitration_id not in without
        ]
    return found


def problems(report):
    return {each.signal: each.problem for each in report.slots if each.problem}


def changed(tmp_path, old, new):
    for name in ("car.dbc", "line.csv"):
        (tmp_path / name).write_text((EXAMPLE.parent / name).read_text())
    text = EXAMPLE.read_text()
    assert old in text
    (tmp_path / "car.toml").write_text(text.replace(old, new))
    return read_car(tmp_path / "car.toml")


def test_a_right_mapping_has_no_problem():
    report = check_signals(example(), frames())
    assert report.is_ok, (problems(report), report.relations)
    speed = report.figures()["signals"][0]
    assert speed["period_s"] == pytest.approx(0.025)
    assert speed["highest"] == pytest.approx(20.0)


SPEED_COLUMN = '"VehicleSpeed", unit = "km/h"'
YAW_COLUMN = 'column = "Localisation.Yaw", unit = "deg"'


@pytest.mark.parametrize(
    ("old", "new", "relation"),
    [
        ('"YawRateRight", unit = "deg/s", sign = -1', '"YawRateRight"', "slope of pose.yaw"),
        (SPEED_COLUMN, f"{SPEED_COLUMN}, factor = 3.6", "speed of the pose = v_x"),
        (YAW_COLUMN, f"{YAW_COLUMN}, offset = 90.0", "direction of motion of the pose"),
        (YAW_COLUMN, f"{YAW_COLUMN}, factor = 1e-9", "slope of pose.yaw"),
    ],
)
def test_a_signal_that_contradicts_the_pose_is_found(tmp_path, old, new, relation):
    report = check_signals(changed(tmp_path, old, new), frames())
    found = report.figures()["contradictions"]
    assert any(each["problem"].startswith(relation) for each in found), found
    assert not report.is_ok


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('kind = "crc8_0x1d"', 'kind = "xor8"', "wrong checksum"),
        (SPEED_COLUMN, f"{SPEED_COLUMN}, plausible = [0, 9]", "cannot be used"),
    ],
)
def test_what_is_wrong_with_a_signal_is_named(tmp_path, old, new, problem):
    report = check_signals(changed(tmp_path, old, new), frames())
    assert problem in problems(report)["states.vx_mps"]


def test_a_message_that_does_not_arrive_is_named_with_its_identifier():
    found = problems(check_signals(example(), frames(without=(0x18FF0500,))))
    assert list(found) == ["states.yaw_rate_radps"]
    assert "29-bit id 0x18ff0500" in found["states.yaw_rate_radps"]


def test_a_gap_is_named():
    sent = [each for each in frames() if not 2.0 < each[0] < 2.6]
    assert "a gap of" in problems(check_signals(example(), sent))["states.vx_mps"]


def test_silence_is_named():
    report = check_signals(example(), [])
    assert set(problems(report).values()) == {"no frame at all"}
    assert report.figures()["ok"] is False
