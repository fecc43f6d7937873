"""`offline-import` makes a data set of logs."""

import json
import struct

import can
import numpy as np
import pytest
from made_import import change_log, columns_of, make_place, run_import
from made_logs import MAPPING, POSE, make_drive, write_csv

from offline.data.dataset import load_dataset
from offline.data.manifest import Imported, read_manifest
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import VEHICLE

DBC = """VERSION ""
BU_: ECU
BO_ 256 MOTION: 8 ECU
 SG_ speed : 0|16@1+ (0.01,0) [0|0] "km/h" ECU
 SG_ side : 16|16@1- (0.001,0) [0|0] "m/s" ECU
 SG_ turn : 32|16@1- (0.0001,0) [0|0] "rad/s" ECU
BO_ 512 DRIVER: 4 ECU
 SG_ wheel : 0|16@1- (0.00001,0) [0|0] "rad" ECU
 SG_ force : 16|16@1- (1,0) [0|0] "N" ECU
"""


@pytest.fixture
def place(tmp_path):
    return make_place(tmp_path)


def test_logs_become_a_data_set_that_loads(place):
    assert run_import(place, "--data", place / "data", "--json", place / "figures.json") == 0
    dataset = load_dataset(place / "data")
    assert dataset.schema.state_names == ("vx_mps", "vy_mps", "yaw_rate_radps")
    assert dataset.schema.input_names == ("road_wheel_rad", "force_n")
    assert [len(dataset.episodes(part)) for part in ("train", "validation", "test")] == [1, 1, 1]
    windows = dataset.select("train")
    assert windows.x.shape == (7, 81, 3)
    assert windows.w.shape == (7, 80, 0)
    assert windows.past.shape == (7, 20, 5)
    made = make_drive(15.0, 0.01, int(dataset.episodes("train")[0]))
    expected = np.interp(0.5 + 0.025 * np.arange(81), made.time, made.turn)
    np.testing.assert_allclose(windows.x[0, :, 2], expected, atol=1e-3)
    figures = json.loads((place / "figures.json").read_text())
    assert figures["sha256"] == dataset.sha256
    assert figures["n_slices"] == {"train": 7, "validation": 7, "test": 7}
    assert [each["file"] for each in figures["episodes"]] == [f"run_{k}.csv" for k in range(3)]


def test_the_import_says_before_the_next_command_that_the_car_is_not_the_simulated_one(
    place, capsys
):
    run_import(place, "--data", place / "data", "--json", place / "figures.json")
    car = json.loads((place / "figures.json").read_text())["car"]
    assert "not the simulated one: rt-controller --bus virtual drives another car" in car
    before, _, after = " ".join(capsys.readouterr().out.split()).partition("Next,")
    assert car in before
    assert "offline-train" in after


def test_the_data_set_records_its_logs_and_its_mapping(place):
    run_import(place, "--data", place / "data")
    origin = read_manifest(place / "data" / "manifest.json").origin
    assert isinstance(origin, Imported)
    assert [file.name for file in origin.files] == ["run_0.csv", "run_1.csv", "run_2.csv"]
    assert origin.mapping == MAPPING


def test_the_car_of_the_mapping_goes_into_the_data_set(place):
    run_import(place, "--data", place / "unknown")
    assert load_dataset(place / "unknown").car is None
    car = (
        "[car]\nwheelbase_m = 3.2\nrear_axle_m = 1.5\nsteering_ratio = 16.0\nlargest_brake_n = 90\n"
    )
    (place / "map.toml").write_text(f"{MAPPING}{car}")
    run_import(place, "--data", place / "known")
    car = load_dataset(place / "known").car
    assert car.geometry == SteeringGeometry(3.2, 1.5, 16.0)
    assert car.own_values == {"largest_brake_n": 90.0}


def test_the_same_logs_give_the_same_numbers(place):
    run_import(place, "--data", place / "one")
    run_import(place, "--data", place / "two")
    assert load_dataset(place / "one").sha256 == load_dataset(place / "two").sha256


def test_without_a_folder_the_logs_are_only_checked(place, capsys):
    before = sorted(place.rglob("*"))
    assert run_import(place) == 0
    assert sorted(place.rglob("*")) == before
    assert "3 episodes" in capsys.readouterr().out


def test_units_and_signs_of_the_mapping_give_the_same_numbers(place):
    run_import(place, "--data", place / "plain")
    for seed in range(3):
        change_log(
            place,
            seed,
            speed=lambda v: v * 3.6,
            turn=lambda r: -np.degrees(r),
        )
    text = MAPPING.replace('"speed", unit = "m/s"', '"speed", unit = "km/h"')
    text = text.replace('unit = "rad/s"', 'unit = "deg/s", sign = -1')
    (place / "map.toml").write_text(text)
    run_import(place, "--data", place / "other")
    plain, other = (load_dataset(place / name).recording for name in ("plain", "other"))
    np.testing.assert_allclose(plain.x, other.x, rtol=1e-5, atol=1e-6)


def test_another_period_than_that_of_the_controller_is_allowed_and_reported(place, capsys):
    (place / "map.toml").write_text("period_s = 0.04\n" + MAPPING)
    run_import(place, "--data", place / "data")
    assert load_dataset(place / "data").schema.dt_s == 0.04
    assert "every 25 ms only" in " ".join(capsys.readouterr().out.split())


def test_poses_give_a_data_set_with_the_signals_of_the_controller(place, capsys):
    text = """
[time]
column = "time"
[states]
vx_mps = { column = "speed", unit = "m/s" }
vy_mps = { column = "side", unit = "m/s" }
yaw_rate_radps = { column = "turn", unit = "rad/s" }
[inputs]
throttle = { column = "force", unit = "%", factor = 0.005, sampling = "held" }
brake_n = { column = "side", unit = "N", quantity = "other" }
steer_rad = { column = "wheel", unit = "rad", factor = 15.0 }
"""
    (place / "map.toml").write_text(text + POSE)
    run_import(place, "--data", place / "data")
    dataset = load_dataset(place / "data")
    assert dataset.schema == VEHICLE
    assert dataset.recording.has_poses
    windows = dataset.select("test")
    assert windows.x.shape[1:] == (81, 6)
    np.testing.assert_allclose(windows.x[:, 0, 3], 0.025 * windows.x[:, 0, 0], rtol=0.04)
    assert "do not drive" not in capsys.readouterr().out


def test_path_states_of_a_drive_around_a_track_are_relative_to_its_line(place):
    angle = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    write_csv(place / "track.csv", {"x": 30 * np.cos(angle), "y": 30 * np.sin(angle)})
    for seed in range(3):
        made = make_drive(15.0, 0.01, seed)
        way = np.cumsum(made.speed) * 0.01 / 29.0
        change_log(
            place,
            seed,
            x=lambda x, way=way: 29.0 * np.cos(way),
            y=lambda y, way=way: 29.0 * np.sin(way),
            yaw=lambda yaw, way=way: way + np.pi / 2,
        )
    line = 'reference_line = "track.csv"\nclosed = true\n'
    (place / "map.toml").write_text(MAPPING + POSE + line)
    run_import(place, "--data", place / "data")
    dataset = load_dataset(place / "data")
    assert not dataset.recording.has_poses
    windows = dataset.select("train")
    np.testing.assert_allclose(windows.x[..., 4], 1.0, atol=0.05)
    np.testing.assert_allclose(windows.w, 1 / 30.0, rtol=0.05)
    np.testing.assert_allclose(windows.x[..., 3], 0.025 * windows.x[..., 0] * 30 / 29, rtol=0.02)


def test_a_drive_that_leaves_the_line_is_cut_there_and_reported(place, capsys):
    write_csv(place / "track.csv", {"x": np.arange(-50.0, 300.0), "y": np.zeros(350)})
    for seed in range(3):
        way = 0.15 * np.arange(1501)
        change_log(
            place,
            seed,
            x=lambda x, way=way: way,
            y=lambda y: np.where(np.arange(1501) < 800, 1.0, 60.0),
            yaw=lambda yaw: 0.0 * yaw,
        )
    line = 'reference_line = "track.csv"\n[checks]\naccept_units = true\n'
    (place / "map.toml").write_text(MAPPING + POSE + line)
    run_import(place, "--json", place / "figures.json")
    figures = json.loads((place / "figures.json").read_text())
    assert figures["kept_s"] == pytest.approx(3 * 7.9, abs=0.3)
    assert "reference line" in {issue["check"] for issue in figures["issues"]}


def test_a_short_log_among_long_ones_is_left_out_and_counted(place):
    short = {name: values[:23] for name, values in columns_of(7).items()}
    write_csv(place / "logs" / "short.csv", short)
    run_import(place, "--data", place / "data", "--json", place / "figures.json")
    assert read_manifest(place / "data" / "manifest.json").rejected_episodes == 1
    assert json.loads((place / "figures.json").read_text())["n_too_short"] == 1


def test_a_can_log_gives_the_same_data_set_as_a_table(place):
    """Equal up to the resolution of the frames."""
    run_import(place, "--data", place / "table")
    (place / "logs-can").mkdir()
    (place / "car.dbc").write_text(DBC)
    for seed in range(3):
        made = make_drive(15.0, 0.01, seed)
        with can.Logger(place / "logs-can" / f"run_{seed}.blf") as log:
            for k, t_s in enumerate(made.time):
                motion = struct.pack(
                    "<Hhhh",
                    round(made.speed[k] * 3.6 / 0.01),
                    round(made.side[k] / 0.001),
                    round(made.turn[k] / 1e-4),
                    0,
                )
                driver = struct.pack("<hh", round(made.wheel[k] / 1e-5), round(made.force[k]))
                for frame_id, data in ((256, motion), (512, driver)):
                    log(can.Message(1e9 + t_s, frame_id, is_extended_id=False, data=data))
    text = MAPPING.replace('column = "time"', "").replace('"m/s"', '"km/h"', 1)
    (place / "map.toml").write_text(text + '[can]\ndbc = "car.dbc"\n')
    (place / "logs").rename(place / "logs-csv")
    (place / "logs-can").rename(place / "logs")
    run_import(place, "--data", place / "can")
    table, bus = (load_dataset(place / name).recording for name in ("table", "can"))
    np.testing.assert_array_equal(table.first, bus.first)
    np.testing.assert_allclose(bus.x, table.x, atol=2e-3)
    np.testing.assert_allclose(bus.u, table.u, rtol=1e-3, atol=0.6)


def test_a_late_signal_is_reported_with_the_delay_to_write(place, capsys):
    for seed in range(3):
        change_log(place, seed, turn=lambda r: np.concatenate([np.full(32, r[0]), r[:-32]]))
    run_import(place, "--json", place / "figures.json")
    (issue,) = json.loads((place / "figures.json").read_text())["issues"]
    assert (issue["check"], issue["subject"]) == ("time shift", "yaw_rate_radps")
    assert "delay_s, about 0.3" in issue["message"]
