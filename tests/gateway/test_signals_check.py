"""What is wrong with a mapping is named, from frames and from the relations of signals."""

from functools import cache
from math import cos, sin

import numpy as np
import pytest
from own_car import EXAMPLE, VALUES, command_writer, example, state_writer

from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import DEFAULT_GEOMETRY, UNDERSTEER_RAD_PER_MPS2
from rt_controller.gateway.command_check import require_sendable
from rt_controller.gateway.signal_relations import check_relations
from rt_controller.gateway.signals_check import check_signals
from rt_controller.mapping.can_log import LoggedFrame
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
        for frame in writer.frames(values, tick):
            if frame.arbitration_id not in without:
                frame.timestamp = time_s
                found.append(LoggedFrame(len(found) + 1, frame, "0"))
    return found


def check(car, sent):
    return check_signals(car, sent, "a.log")


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
    report = check(changed(tmp_path, old, new), frames())
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
    report = check(changed(tmp_path, old, new), frames())
    assert problem in problems(report)["states.vx_mps"]


def test_a_message_that_does_not_arrive_is_named_with_its_identifier():
    found = problems(check(example(), frames(without=(0x18FF0500,))))
    assert list(found) == ["states.yaw_rate_radps"]
    assert "29-bit id 0x18ff0500" in found["states.yaw_rate_radps"]


def test_a_gap_is_named():
    sent = [each for each in frames() if not 2.0 < each.frame.timestamp < 2.6]
    assert "a gap of" in problems(check(example(), sent))["states.vx_mps"]


def test_silence_is_named():
    report = check(example(), [])
    assert set(problems(report).values()) == {"no frame at all"}
    assert report.figures()["ok"] is False


SPEED_MPS, STEP_S, TICKS = 20.0, 0.025, 800
VY = "states.vy_mps"
NOISE = {
    "states.vx_mps": 0.1,
    "states.vy_mps": 0.03,
    "states.yaw_rate_radps": 0.005,
    "states.ey_m": 0.03,
    "states.epsi_rad": 0.003,
    "exogenous.curvature_per_m": 1e-4,
    "inputs.steer_rad": 0.01,
}


@cache
def slalom_drive(turn=1.0):
    """A slalom on a straight road, then a curve of it: columns by slot, every 25 ms."""
    time_s = STEP_S * np.arange(TICKS)
    curvature = np.where(time_s < 10.0, 0.0, 0.007 * turn)
    slalom = 0.12 * turn * np.cos(0.8 * np.pi * time_s) * (time_s < 10.0)
    yaw_rate = slalom + curvature * SPEED_MPS
    epsi = STEP_S * np.cumsum(slalom)
    vy = np.where(time_s < 10.0, -1.5 * yaw_rate, 0.0)
    wheel = DEFAULT_GEOMETRY.steering_ratio * yaw_rate / SPEED_MPS
    wheel *= DEFAULT_GEOMETRY.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * SPEED_MPS**2
    constant = np.ones(TICKS)
    return {
        "states.vx_mps": SPEED_MPS * constant,
        "states.vy_mps": vy,
        "states.yaw_rate_radps": yaw_rate,
        "states.ey_m": STEP_S * np.cumsum(SPEED_MPS * np.sin(epsi) + vy * np.cos(epsi)),
        "states.epsi_rad": epsi,
        "exogenous.curvature_per_m": curvature,
        "inputs.steer_rad": wheel,
        "commands.steer_rad": wheel,
        "reference.v_mps": SPEED_MPS * constant,
        "mission.engage": constant,
    }


def relations_of(columns, factors=(), noise=1.0, **more):
    """Names of the contradicted relations, and reasons of those that were not compared."""
    rng, scale = np.random.default_rng(0), dict(factors)
    time_s = STEP_S * np.arange(TICKS)
    tracks = {}
    for name, values in columns.items():
        measured = values + noise * NOISE.get(name, 0.0) * rng.normal(size=TICKS)
        tracks[name] = list(zip(time_s, scale.get(name, 1.0) * measured, strict=True))
    found = check_relations(tracks, None)
    return (
        [text for text, answer in found.items() if answer.startswith("yes")],
        {text: answer for text, answer in found.items() if answer.startswith("not compared: ")},
    )


def without_columns(*names):
    return {name: values for name, values in slalom_drive().items() if name not in names}


def with_columns(**columns):
    """The slalom_drive with other columns, by the last part of their slots."""
    names = {name.partition(".")[2]: name for name in slalom_drive()}
    return {**slalom_drive(), **{names[key]: value for key, value in columns.items()}}


@pytest.mark.parametrize("noise", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("absent", [(), (VY,), ("commands.steer_rad",)])
def test_a_right_mapping_has_no_contradiction(noise, absent):
    assert relations_of(without_columns(*absent), noise=noise) == ([], {})


@pytest.mark.parametrize(
    ("signal", "factor", "broken"),
    [
        ("states.yaw_rate_radps", -1.0, "slope of epsi_rad"),
        ("states.yaw_rate_radps", 0.01745, "slope of epsi_rad"),
        ("states.yaw_rate_radps", 57.3, "v_x * yaw rate"),
        ("states.ey_m", -1.0, "slope of ey_m"),
        ("states.ey_m", 0.1, "slope of ey_m"),
        ("states.ey_m", 100.0, "slope of ey_m"),
        ("states.epsi_rad", -1.0, "slope of epsi_rad"),
        ("states.epsi_rad", 0.01745, "slope of epsi_rad"),
        ("states.epsi_rad", 57.3, "slope of epsi_rad"),
        ("states.epsi_rad", 0.0, "slope of epsi_rad"),
        ("states.vy_mps", -1.0, "sign of vy_mps"),
        ("states.vx_mps", 0.2777, "slope of ey_m"),
        ("states.vx_mps", 3.6, "slope of ey_m"),
        ("exogenous.curvature_per_m", -1.0, "curvature_per_m"),
        ("exogenous.curvature_per_m", 10.0, "curvature_per_m"),
        ("exogenous.curvature_per_m", 0.1, "curvature_per_m"),
        ("inputs.steer_rad", -1.0, "inputs.steer_rad"),
        ("inputs.steer_rad", 0.0, "inputs.steer_rad"),
        ("inputs.steer_rad", 0.01745, "inputs.steer_rad"),
        ("inputs.steer_rad", 18.5, "inputs.steer_rad"),
        ("commands.steer_rad", -1.0, "commands.steer_rad"),
        ("commands.steer_rad", 57.3, "commands.steer_rad"),
        ("commands.steer_rad", 0.1, "commands.steer_rad"),
    ],
)
def test_a_wrong_sign_or_factor_contradicts_a_relation_of_the_signal(signal, factor, broken):
    contradicted, _ = relations_of(slalom_drive(), {signal: factor}, noise=0.3)
    assert any(text.startswith(broken) for text in contradicted), contradicted


def test_a_straight_drive_is_not_compared_and_no_contradiction():
    contradicted, not_compared = relations_of(slalom_drive(turn=0.0))
    assert contradicted == []
    assert set(not_compared.values()) == {"not compared: too little motion"}
    assert len(not_compared) == 6


def test_a_signal_without_samples_is_named():
    _, not_compared = relations_of(
        with_columns(epsi_rad=np.full(TICKS, np.nan)) | {"x": np.zeros(TICKS)}
    )
    assert "slope of epsi_rad = yaw rate - curvature * v_x" in not_compared


@pytest.mark.parametrize(
    "columns",
    [
        {"ey_m": slalom_drive()["states.ey_m"] + 3.5 * (np.arange(TICKS) % 160 > 80)},
        {"epsi_rad": slalom_drive()["states.epsi_rad"] + 0.01},
        {"yaw_rate_radps": slalom_drive()["states.yaw_rate_radps"] + 0.005},
        {"epsi_rad": np.roll(slalom_drive()["states.epsi_rad"], 1)},
    ],
    ids=["next lane", "offset of heading", "offset of yaw rate", "delay"],
)
def test_usual_errors_of_sensors_are_no_contradiction(columns):
    assert relations_of(with_columns(**columns))[0] == []


@pytest.mark.parametrize(("name", "value"), [("engage", 0.0), ("car_brakes", 1.0)])
def test_commands_that_the_car_does_not_follow_are_not_compared(name, value):
    columns = with_columns(engage=slalom_drive()["mission.engage"])
    columns["commands.steer_rad"] = -columns["commands.steer_rad"]
    found = relations_of(columns | {f"mission.{name}": np.full(TICKS, value)})
    assert found[0] == []
    assert any(each.startswith("commands.steer_rad") for each in found[1])


def in_dbc(tmp_path, *changes):
    """The example with another DBC."""
    car, text = changed(tmp_path, "[can]", "[can]"), (tmp_path / "car.dbc").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "car.dbc").write_text(text)
    return read_car(car.path)


SPEED_SIGNAL = "VehicleSpeed : 7|16@0+ (0.01,0) [0|400]"
YAW_RATE_SIGNAL = "YawRateRight : 7|16@0- (0.005,0) [-160|160]"


@pytest.mark.parametrize(
    ("change", "signal", "expected"),
    [
        (("WheelSpeed: 8", "WheelSpeed: 9"), "states.vx_mps", "have 8 bytes, the DBC says 9"),
        ((SPEED_SIGNAL, SPEED_SIGNAL.replace("400", "1")), "states.vx_mps", "is a placeholder ([0"),
        (
            (YAW_RATE_SIGNAL, YAW_RATE_SIGNAL.replace("-160|160", "0|327.675")),
            "states.yaw_rate_radps",
            "is a placeholder (the signal is signed",
        ),
        (
            ("BO_ 291 25;", "BO_ 291 200;"),
            "states.vx_mps",
            "a sample every 25 ms, the DBC says 200 ms",
        ),
    ],
)
def test_a_contradiction_of_bus_and_dbc_is_named_with_both(tmp_path, change, signal, expected):
    report = check(in_dbc(tmp_path, change), frames())
    (found,) = (each for each in report.slots if each.signal == signal)
    assert expected in f"{found.problem}. {found.remedy}"


def test_a_plausible_range_of_the_mapping_replaces_that_of_the_dbc(tmp_path):
    in_dbc(tmp_path, (SPEED_SIGNAL, SPEED_SIGNAL.replace("400", "1")))
    path = tmp_path / "car.toml"
    path.write_text(path.read_text().replace(SPEED_COLUMN, f"{SPEED_COLUMN}, plausible = [0, 60]"))
    assert check(read_car(path), frames()).is_ok


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


@pytest.mark.parametrize(
    ("factor", "hint"), [(-1.0, "try sign = -1"), (0.1, "0.1 times as expected")]
)
def test_a_contradicted_relation_says_by_how_much(factor, hint):
    tracks = {
        name: list(zip(STEP_S * np.arange(TICKS), values, strict=True))
        for name, values in slalom_drive().items()
    }
    tracks["states.epsi_rad"] = [(t, factor * x) for t, x in tracks["states.epsi_rad"]]
    answer = check_relations(tracks, None)["slope of epsi_rad = yaw rate - curvature * v_x"]
    assert answer.startswith("yes")
    assert hint in answer


def test_the_load_of_the_bus_is_given():
    report = check(example(), frames())
    sent = frames()
    bits = sum((67 if f.frame.is_extended_id else 47) + 8 * len(f.frame.data) for f in sent)
    assert report.bus_load_percent == pytest.approx(100.0 * bits / 500e3 / sent[-1].frame.timestamp)


WHEEL = "WheelRequestRight m1 : 24|16@1- (0.02,0) [-600|600]"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ([], None),
        ([(WHEEL, WHEEL.replace("-600|600", "0|0"))], None),  # no range, and bits for ±655 deg
        ([(WHEEL, WHEEL.replace("-600|600", "0|1"))], "may have 0 to 1 deg, .* -40 to 40 deg"),
        ([(WHEEL, WHEEL.replace("-600|600", "-30|30"))], "may have -30 to 30 deg"),
        ([(WHEEL, WHEEL.replace("24|16@1-", "24|11@1-"))], "may have -20.48 to 20.46 deg"),
        ([(WHEEL, WHEEL.replace("16@1-", "16@1+").replace("-600", "0"))], "may have 0 to 600"),
        ([("BO_ 2566919168 25;", "BO_ 2566919168 10;")], "every 10 ms, the gateway .* 25 ms"),
    ],
)
def test_commands_that_the_dbc_does_not_allow_are_refused_before_the_drive(
    tmp_path, changes, expected
):
    car = in_dbc(tmp_path, *changes) if changes else example()
    if expected is None:
        require_sendable(car, UNNAMED_CAR)
    else:
        with pytest.raises(ConfigError, match=f"(?s){expected}"):
            require_sendable(car, UNNAMED_CAR)


def test_a_signal_with_two_tasks_in_a_message_is_refused(tmp_path):
    car = changed(tmp_path, 'counter = "RequestCounter"', 'counter = "RequestChecksum"')
    with pytest.raises(ConfigError, match="RequestChecksum, found the checksum and the counter"):
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
    wrong = changed(tmp_path, 'kind = "crc8_0x2f"', 'kind = "crc8_0x1d"')
    assert "wrong checksum" in problems(check(wrong, sent))["commands.steer_rad"]
