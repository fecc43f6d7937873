"""Logs without lateral speed: it is estimated from what they have, and the data set drives."""

import json

import numpy as np
import pytest
from made_logs import run_import, write_csv

from offline.data.dataset import load_dataset
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE
from rt_controller.mapping.lateral_speed import LateralSpeed, RearAxle, lateral_speed

MASS_KG, INERTIA, FRONT_M, REAR_M, RATIO = 1500.0, 2400.0, 1.2, 1.5, 15.0
FRONT_STIFFNESS, REAR_STIFFNESS = 90e3, 120e3
AXLE = RearAxle(
    REAR_M, MASS_KG * FRONT_M / ((FRONT_M + REAR_M) * REAR_STIFFNESS), INERTIA / (MASS_KG * FRONT_M)
)
MAPPING = """
[time]
column = "time"
[states]
vx_mps = { column = "vx", unit = "m/s" }
yaw_rate_radps = { column = "rate", unit = "rad/s" }
[inputs]
throttle = { column = "throttle", unit = "1" }
brake_n = { column = "brake", unit = "N" }
steer_rad = { column = "steer", unit = "rad" }
[checks.signals]
measured_mps = { column = "vy", unit = "m/s", quantity = "lateral speed" }
"""
ACCELERATION = 'ay_mps2 = { column = "ay", unit = "m/s^2" }\n'
CAR = f"[car]\nwheelbase_m = {FRONT_M + REAR_M}\nrear_axle_m = {REAR_M}\nsteering_ratio = {RATIO}\n"
CONSTANTS = f"rear_slip_s2_per_m = {AXLE.slip_s2_per_m}\nyaw_inertia_m = {AXLE.inertia_m}\n"
POSE = """[pose]
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
yaw = { column = "yaw", unit = "rad" }
"""
WITHOUT_YAW = POSE.rsplit("yaw =", maxsplit=1)[0]
DEGREES = """[pose]
x = { column = "longitude", unit = "deg" }
y = { column = "latitude", unit = "deg" }
yaw = { column = "compass", unit = "deg", sign = -1, offset = -90.0 }
"""
DEGREES_OF_THE_FILE = DEGREES.replace('itude", unit = "deg"', 'itude"')
LATITUDE_DEG = 48.0
EAST_M, NORTH_M = 74624.0, 111200.0
"""per degree, at that latitude on the ellipsoid"""


def make_car_drive(seed, duration_s=40.0, dt_s=0.005):
    """Columns at 50 Hz of a linear single-track car that starts at rest, with noise."""
    rng = np.random.default_rng(seed)
    t = dt_s * np.arange(round(duration_s / dt_s) + 1)
    speed = np.interp(t, [0.0, 3.0, 12.0, 25.0, 40.0], [0.0, 0.0, 14.0, 24.0, 12.0 + seed])
    phases = rng.uniform(0.0, 2.0 * np.pi, 4)
    waves = [
        np.sin(2.0 * np.pi * f * t + p) for f, p in zip((0.1, 0.3, 0.7, 1.1), phases, strict=True)
    ]
    wheel = 6.0 / (4.0 + 0.03 * speed**2) / 15.0 * np.sum(waves, axis=0) / 4.0
    rows, vy, rate, x, y, yaw = [], 0.0, 0.0, 0.0, 0.0, 0.0
    for v, angle in zip(speed, wheel, strict=True):
        if v > 1.0:
            front = FRONT_STIFFNESS * (angle - (vy + FRONT_M * rate) / v)
            rear = -REAR_STIFFNESS * (vy - REAR_M * rate) / v
            ay, turn = (front + rear) / MASS_KG, (FRONT_M * front - REAR_M * rear) / INERTIA
        else:
            vy, rate, ay, turn = 0.0, 0.0, 0.0, 0.0
        rows.append((v, vy, rate, ay, angle, x, y, yaw))
        x += dt_s * (v * np.cos(yaw) - vy * np.sin(yaw))
        y += dt_s * (v * np.sin(yaw) + vy * np.cos(yaw))
        yaw += dt_s * rate
        if v > 1.0:
            vy, rate = vy + dt_s * (ay - v * rate), rate + dt_s * turn
    vx, vy, rate, ay, wheel, x, y, yaw = np.array(rows)[::4].T
    noise = iter(rng.normal(size=(7, len(vx))))
    x, y, yaw = x + 0.02 * next(noise), y + 0.02 * next(noise), yaw + 0.0035 * next(noise)
    return {
        "time": t[::4],
        "vx": vx,
        "vy": vy,
        "rate": rate + 0.0015 * next(noise),
        "ay": 1.05 * ay + 0.1 + 0.1 * next(noise),
        "throttle": 0.1 + 0.05 * np.sin(t[::4]),
        "brake": 5.0 + 5.0 * np.sin(0.3 * t[::4]),
        "steer": RATIO * wheel + 0.005 * next(noise),
        "x": x,
        "y": y,
        "yaw": yaw,
        "longitude [deg]": 11.0 + x / EAST_M,
        "latitude [deg]": LATITUDE_DEG + y / NORTH_M,
        "compass": np.mod(90.0 - np.degrees(yaw), 360.0),
    }


DRIVES = tuple(make_car_drive(seed) for seed in range(3))


@pytest.fixture
def place(tmp_path):
    (tmp_path / "logs").mkdir()
    for seed, drive in enumerate(DRIVES):
        write_csv(tmp_path / "logs" / f"run_{seed}.csv", drive)
    return tmp_path


def imported(place, text):
    """Data set of the mapping, and its figures."""
    (place / "map.toml").write_text(text)
    assert run_import(place, "--data", place / "data", "--json", place / "figures.json") == 0
    return load_dataset(place / "data"), json.loads((place / "figures.json").read_text())


@pytest.mark.parametrize(
    ("text", "way", "largest_mps"),
    [
        (MAPPING + POSE, "pose", 0.05),
        (MAPPING + DEGREES, "pose", 0.05),
        (MAPPING + DEGREES_OF_THE_FILE, "pose", 0.05),
        (MAPPING + WITHOUT_YAW, "pose", 0.05),
        (MAPPING.replace("yaw_rate_radps", "#") + POSE, "pose", 0.05),
        (MAPPING + ACCELERATION + CAR, "lateral acceleration", 0.05),
        (MAPPING + CAR, "yaw rate and steering", 0.1),
        (MAPPING + CAR + CONSTANTS, "yaw rate", 0.02),
    ],
)
def test_the_lateral_speed_of_a_known_car_is_found(place, capsys, text, way, largest_mps):
    dataset, figures = imported(place, text)
    found = figures["lateral_speed"]
    assert found["way"] == way
    assert found["rms_mps"] < largest_mps
    assert found["rms_mps"] < 3.0 * found["std_mps"] + 0.002
    assert found["rear_slip_s2_per_m"] == pytest.approx(AXLE.slip_s2_per_m, rel=0.35)
    assert dataset.schema == VEHICLE
    assert dataset.recording.has_poses
    assert dataset.car.rear_slip_s2_per_m == found["rear_slip_s2_per_m"]
    assert dataset.car.yaw_inertia_m == found["yaw_inertia_m"]
    printed = capsys.readouterr().out
    assert "do not drive" not in printed
    assert "[car]\n" in printed


def test_a_standing_car_has_none_and_a_gap_restarts_the_estimate(place):
    drive = {name: np.delete(values, slice(900, 1000)) for name, values in DRIVES[1].items()}
    write_csv(place / "logs" / "run_1.csv", drive)
    dataset, figures = imported(place, MAPPING + POSE)
    assert figures["n_episodes"] == 4
    assert figures["lateral_speed"]["rms_mps"] < 0.05
    x = dataset.recording.x
    assert np.all(x[x[:, 0] < 0.01, 1] == 0.0)


def test_a_car_that_never_drives_fast_enough_for_a_fit_has_the_speed_of_rolling(place):
    for seed, drive in enumerate(DRIVES):
        slow = {**drive, "vx": 0.03 * drive["vx"]}
        write_csv(place / "logs" / f"run_{seed}.csv", slow)
    checks = "[checks]\naccept_units = true\n"
    dataset, _ = imported(place, MAPPING + ACCELERATION + CAR + checks)
    vx, vy, rate = dataset.recording.x[:, :3].T
    np.testing.assert_allclose(vy, np.where(vx >= 0.3, REAR_M * rate, 0.0), atol=0.05)


@pytest.mark.parametrize(("ahead_m", "is_wrong"), [(-1.3, False), (1.3, True)])
def test_a_pose_beside_the_centre_of_gravity_is_moved_there(place, capsys, ahead_m, is_wrong):
    for seed, drive in enumerate(DRIVES):
        cos, sin = np.cos(drive["yaw"]), np.sin(drive["yaw"])
        moved = {"x": drive["x"] - 1.3 * cos - 0.4 * sin, "y": drive["y"] - 1.3 * sin + 0.4 * cos}
        write_csv(place / "logs" / f"run_{seed}.csv", {**drive, **moved})
    _, figures = imported(place, MAPPING + POSE + f"ahead_m = {ahead_m}\nleft_m = 0.4\n")
    assert (figures["lateral_speed"]["rms_mps"] > 0.05) == is_wrong
    assert ("this v_y may be wrong. Check ahead_m" in capsys.readouterr().out) == is_wrong


def test_the_logs_can_stay_without_lateral_speed(place, capsys):
    dataset, figures = imported(place, f'lateral_speed = "none"\n{MAPPING}')
    assert dataset.schema.state_names == ("vx_mps", "yaw_rate_radps")
    assert figures["lateral_speed"] is None
    assert "do not drive" in capsys.readouterr().out


@pytest.mark.parametrize("text", [MAPPING + POSE, MAPPING + ACCELERATION + CAR])
def test_logs_without_a_stretch_long_enough_are_refused(place, text):
    for seed, drive in enumerate(DRIVES):
        short = {name: values[400:403] for name, values in drive.items()}
        write_csv(place / "logs" / f"run_{seed}.csv", short)
    (place / "map.toml").write_text(text)
    with pytest.raises(DatasetError, match="at least 101 samples"):
        run_import(place)


def test_whole_drives_have_the_estimate_of_the_gateway():
    vx, rate = DRIVES[0]["vx"], DRIVES[0]["rate"]
    estimator = LateralSpeed(AXLE)
    expected = [estimator.update(*each) for each in zip(vx.tolist(), rate.tolist(), strict=True)]
    np.testing.assert_allclose(lateral_speed(AXLE, vx, rate, 0.025), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (MAPPING + POSE.replace('"x", unit = "m"', '"x", unit = "deg"'), ConfigError, "both in m"),
        (MAPPING + WITHOUT_YAW + "ahead_m = 1.0\n", ConfigError, "that of the centre of gravity"),
        (
            MAPPING.replace("yaw_rate_radps", "#") + WITHOUT_YAW,
            ConfigError,
            "only if yaw_rate_radps is mapped",
        ),
        (
            MAPPING + DEGREES_OF_THE_FILE.replace('"latitude"', '"y", unit = "m"'),
            DatasetError,
            "x and y both in m, or longitude and latitude in deg, found rad and m",
        ),
        (MAPPING + DEGREES + 'reference_line = "a.csv"\n', ConfigError, "frame of the reference"),
        (
            MAPPING + DEGREES.replace(", offset = -90.0", ""),
            DatasetError,
            r"direction of motion of the pose = pose\.yaw: .*offset = -90 in deg",
        ),
        (
            MAPPING + DEGREES_OF_THE_FILE + 'reference_line = "a.csv"\n',
            DatasetError,
            "frame of the reference",
        ),
        (
            MAPPING + DEGREES.replace('"latitude"', '"compass"'),
            DatasetError,
            r"compass, line \d+: expected a latitude within 90 deg",
        ),
    ],
)
def test_a_pose_that_does_not_fit_is_refused(place, text, error, message):
    (place / "map.toml").write_text(text)
    with pytest.raises(error, match=message):
        run_import(place)
