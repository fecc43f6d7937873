"""What is wrong with a mapping is named with its remedy, from frames alone."""

from math import cos, sin

import pytest
from own_car import EXAMPLE, VALUES, example, state_writer

from rt_controller.gateway.signals_check import check_signals
from rt_controller.mapping.car_file import read_car

YAW_RATE, SPEED = 0.1, 20.0


def frames(ticks=200, without=(), heading_rad=None):
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
            "pose.yaw": yaw if heading_rad is None else heading_rad,
        }
        found += [
            (time_s, frame)
            for frame in writer.frames(values, tick)
            if frame.arbitration_id not in without
        ]
    return found


def problems(report):
    return {each.slot.name: each.problem for each in report.slots if each.problem}


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
    speed = report.slots[0].figures()
    assert speed["period_s"] == pytest.approx(0.025)
    assert speed["highest"] == pytest.approx(20.0)


def test_a_message_that_does_not_arrive_is_named_with_its_identifier():
    report = check_signals(example(), frames(without=(0x18FF0500,)))
    found = problems(report)
    assert list(found) == ["states.yaw_rate_radps"]
    assert "29-bit id 0x18ff0500" in found["states.yaw_rate_radps"]


def test_a_gap_is_named():
    sent = [each for each in frames() if not 2.0 < each[0] < 2.6]
    assert "a gap of" in problems(check_signals(example(), sent))["states.vx_mps"]


def test_a_wrong_sign_of_the_yaw_rate_is_found_by_the_pose(tmp_path):
    car = changed(tmp_path, '"YawRateRight", unit = "deg/s", sign = -1', '"YawRateRight"')
    (problem, remedy), *_ = check_signals(car, frames()).relations
    assert "a wrong sign?" in problem
    assert "states.yaw_rate_radps" in remedy


def test_a_wrong_factor_of_the_speed_is_found_by_the_pose(tmp_path):
    car = changed(
        tmp_path, '"VehicleSpeed", unit = "km/h"', '"VehicleSpeed", unit = "km/h", factor = 3.6'
    )
    assert any(
        "km/h taken for m/s" in problem for problem, _ in check_signals(car, frames()).relations
    )


def test_a_heading_that_is_not_that_of_the_motion_is_found(tmp_path):
    old = 'column = "Localisation.Yaw", unit = "deg"'
    car = changed(tmp_path, old, f"{old}, offset = 90.0")
    ((problem, remedy),) = check_signals(car, frames()).relations
    assert problem.startswith("the pose moves at -9")
    assert "offset of pose.yaw" in remedy


def test_a_heading_that_stays_at_zero_in_a_turn_is_found():
    found = [problem for problem, _ in check_signals(example(), frames(heading_rad=0.0)).relations]
    assert "the slope of pose.yaw is 0 while states.yaw_rate_radps is not" in found


def test_a_wrong_kind_of_checksum_is_named(tmp_path):
    car = changed(tmp_path, 'kind = "crc8_0x1d"', 'kind = "xor8"')
    assert "wrong checksum" in problems(check_signals(car, frames()))["states.vx_mps"]


def test_an_implausible_value_is_named(tmp_path):
    car = changed(
        tmp_path,
        '"VehicleSpeed", unit = "km/h"',
        '"VehicleSpeed", unit = "km/h", plausible = [0, 9]',
    )
    assert "cannot be used" in problems(check_signals(car, frames()))["states.vx_mps"]


def test_silence_is_named():
    report = check_signals(example(), [])
    assert set(problems(report).values()) == {"no frame at all"}
    assert report.figures()["ok"] is False
