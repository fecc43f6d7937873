"""What is wrong with a mapping is named, in frames, in the DBC, and between signals."""

from math import cos, sin

import pytest
from own_car import VALUES, changed, command_writer, example, state_writer

from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.gateway.command_check import require_sendable
from rt_controller.gateway.signals_check import check_signals
from rt_controller.mapping.can_log import LoggedFrame

YAW_RATE_RADPS, SPEED_MPS = 0.1, 20.0


def frames(ticks=200, without=()):
    """The car in a turn to the left, 25 ms a tick."""
    writer, found = state_writer(example()), []
    for tick in range(ticks):
        time_s = 0.025 * tick
        yaw, radius = YAW_RATE_RADPS * time_s, SPEED_MPS / YAW_RATE_RADPS
        values = {
            **VALUES,
            "states.yaw_rate_radps": YAW_RATE_RADPS,
            "inputs.steer_rad": 0.36,
            "pose.x": radius * sin(yaw),
            "pose.y": radius * (1.0 - cos(yaw)),
            "pose.yaw": yaw,
        }
        for frame in writer.frames(values, tick):
            if frame.arbitration_id not in without:
                frame.timestamp = time_s
                found.append(LoggedFrame(len(found) + 1, frame, "0"))
    return found


def check(car, sent):
    return check_signals(car, sent, "a.log")


def problems(report):
    return {each.signal: each.problem for each in report.slots if each.problem}


def test_a_right_mapping_has_no_problem():
    report = check(example(), frames())
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
    report = check(changed(tmp_path, (old, new)), frames())
    found = report.figures()["contradictions"]
    assert any(each["problem"].startswith(relation) for each in found), found
    assert not report.is_ok


def test_what_does_not_arrive_is_named():
    found = problems(check(example(), frames(without=(0x18FF0500,))))
    assert list(found) == ["states.yaw_rate_radps"]
    assert "29-bit id 0x18ff0500" in found["states.yaw_rate_radps"]
    sent = [each for each in frames() if not 2.0 < each.frame.timestamp < 2.6]
    assert "a gap of" in problems(check(example(), sent))["states.vx_mps"]
    report = check(example(), [])
    assert set(problems(report).values()) == {"no frame at all"}
    assert report.figures()["ok"] is False


SPEED, YAW_RATE_SLOT = "states.vx_mps", "states.yaw_rate_radps"
SPEED_SIGNAL = "VehicleSpeed : 7|16@0+ (0.01,0) [0|400]"
YAW_RATE_SIGNAL = "YawRateRight : 7|16@0- (0.005,0) [-160|160]"
BAD_RANGE = (SPEED_SIGNAL, SPEED_SIGNAL.replace("400", "1"))
SIGNED_RANGE = (YAW_RATE_SIGNAL, YAW_RATE_SIGNAL.replace("-160|160", "0|327.675"))


@pytest.mark.parametrize(
    ("change", "signal", "expected"),
    [
        (('kind = "crc8_0x1d"', 'kind = "xor8"'), SPEED, "wrong checksum"),
        ((SPEED_COLUMN, f"{SPEED_COLUMN}, plausible = [0, 9]"), SPEED, "cannot be used"),
        (("WheelSpeed: 8", "WheelSpeed: 9"), SPEED, "have 8 bytes, the DBC says 9"),
        (BAD_RANGE, SPEED, "is a placeholder ([0"),
        (SIGNED_RANGE, YAW_RATE_SLOT, "is a placeholder (the signal is signed"),
        (("BO_ 291 25;", "BO_ 291 200;"), SPEED, "a sample every 25 ms, the DBC says 200 ms"),
    ],
)
def test_what_is_wrong_with_a_signal_is_named(tmp_path, change, signal, expected):
    report = check(changed(tmp_path, change), frames())
    (found,) = (each for each in report.slots if each.signal == signal)
    assert expected in f"{found.problem}. {found.remedy}"


def test_a_plausible_range_of_the_mapping_replaces_that_of_the_dbc(tmp_path):
    plausible = (SPEED_COLUMN, f"{SPEED_COLUMN}, plausible = [0, 60]")
    assert check(changed(tmp_path, BAD_RANGE, plausible), frames()).is_ok


def test_a_log_that_begins_before_its_drive_is_judged_from_its_mission_on():
    writer, early = state_writer(example()), []
    for tick in range(100):
        values = {**VALUES, "mission.engage": 0.0, "states.vx_mps": 0.0}
        for frame in writer.frames(values, tick):
            frame.timestamp = 0.025 * tick - 2.5
            if frame.arbitration_id == 0x18FF0500:
                frame.data[:2] = b"\x7f\xff"  # a yaw rate out of its range
            early.append(LoggedFrame(len(early) + 1, frame, "0"))
    report = check(example(), early + frames())
    assert report.is_ok, problems(report)
    assert "cannot be used" in problems(check(example(), early))["states.yaw_rate_radps"]


def test_the_load_of_the_bus_is_given():
    report = check(example(), frames())
    sent = frames()
    bits = sum((67 if f.frame.is_extended_id else 47) + 8 * len(f.frame.data) for f in sent)
    assert report.bus_load_percent == pytest.approx(100.0 * bits / 500e3 / sent[-1].frame.timestamp)


WHEEL = "WheelRequestRight m1 : 24|16@1- (0.02,0) [-600|600]"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ((WHEEL, WHEEL), None),
        ((WHEEL, WHEEL.replace("-600|600", "0|0")), None),  # no range, and bits for ±655 deg
        ((WHEEL, WHEEL.replace("-600|600", "0|1")), "may have 0 to 1 deg, .* -40 to 40 deg"),
        ((WHEEL, WHEEL.replace("-600|600", "-30|30")), "may have -30 to 30 deg"),
        ((WHEEL, WHEEL.replace("24|16@1-", "24|11@1-")), "may have -20.48 to 20.46 deg"),
        ((WHEEL, WHEEL.replace("16@1-", "16@1+").replace("-600", "0")), "may have 0 to 600"),
        (("BO_ 2566919168 25;", "BO_ 2566919168 10;"), "every 10 ms, the gateway .* 25 ms"),
        (('"RequestCounter"', '"RequestChecksum"'), "found the checksum and the counter"),
    ],
)
def test_commands_that_the_dbc_does_not_allow_are_refused_before_the_drive(
    tmp_path, change, expected
):
    car = changed(tmp_path, change)
    if expected is None:
        require_sendable(car, UNNAMED_CAR)
    else:
        with pytest.raises(ConfigError, match=f"(?s){expected}"):
            require_sendable(car, UNNAMED_CAR)


def test_recorded_commands_with_a_wrong_checksum_are_named(tmp_path):
    writer, sent = command_writer(example()), frames()
    values = dict.fromkeys(
        ("commands.throttle", "commands.brake_n", "commands.steer_rad", "commands.mode"), 0.0
    )
    for tick in range(200):
        for frame in writer.frames(values, tick):
            frame.timestamp = 0.025 * tick
            sent.append(LoggedFrame(len(sent) + 1, frame, "0"))
    assert check(example(), sent).is_ok
    wrong = changed(tmp_path, ('kind = "crc8_0x2f"', 'kind = "crc8_0x1d"'))
    assert "wrong checksum" in problems(check(wrong, sent))["commands.steer_rad"]
