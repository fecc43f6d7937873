"""offline-import from logs to a data set: all of it, or a message and nothing."""

import json
import re
import struct

import can
import numpy as np
import pytest
from made_logs import MAPPING, POSE, make_drive, rounded, write_csv

from offline.cli import import_app
from offline.dataset import load_dataset
from offline.manifest import Imported, read_manifest
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.schema import VEHICLE

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
    """Three drives of 15 s and a mapping."""
    (tmp_path / "logs").mkdir()
    for seed in range(3):
        write_csv(tmp_path / "logs" / f"run_{seed}.csv", columns_of(seed))
    (tmp_path / "map.toml").write_text(MAPPING)
    return tmp_path


def columns_of(seed):
    return rounded(make_drive(15.0, 0.01, seed))


def run(place, *options):
    tokens = [str(place / "map.toml"), str(place / "logs"), *map(str, options)]
    return import_app(tokens, result_action="return_value")


def spoil(place, seed=1, **changes):
    columns = columns_of(seed)
    for name, change in changes.items():
        columns[name] = change(np.array(columns[name])).tolist()
    write_csv(place / "logs" / f"run_{seed}.csv", columns)


def test_logs_become_a_data_set_that_loads(place):
    assert run(place, "--data", place / "data", "--json", place / "figures.json") == 0
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


def test_the_data_set_says_which_logs_and_which_mapping_it_came_from(place):
    run(place, "--data", place / "data")
    origin = read_manifest(place / "data" / "manifest.json").origin
    assert isinstance(origin, Imported)
    assert [file.name for file in origin.files] == ["run_0.csv", "run_1.csv", "run_2.csv"]
    assert origin.mapping == MAPPING


def test_the_same_logs_give_the_same_numbers(place):
    run(place, "--data", place / "one")
    run(place, "--data", place / "two")
    assert load_dataset(place / "one").sha256 == load_dataset(place / "two").sha256


def test_without_a_folder_the_logs_are_only_looked_at(place, capsys):
    before = sorted(place.rglob("*"))
    assert run(place) == 0
    assert sorted(place.rglob("*")) == before
    assert "3 episodes" in capsys.readouterr().out


def test_a_data_set_that_is_there_is_not_replaced_unless_asked(place):
    run(place, "--data", place / "data")
    with pytest.raises(ConfigError, match="--replace"):
        run(place, "--data", place / "data")
    assert run(place, "--data", place / "data", "--replace") == 0


def test_units_signs_and_delays_of_the_mapping_end_in_the_same_numbers(place):
    run(place, "--data", place / "plain")
    for seed in range(3):
        spoil(
            place,
            seed,
            speed=lambda v: v * 3.6,
            turn=lambda r: -np.degrees(r),
        )
    text = MAPPING.replace('"speed", unit = "m/s"', '"speed", unit = "km/h"')
    text = text.replace('unit = "rad/s"', 'unit = "deg/s", sign = -1')
    (place / "map.toml").write_text(text)
    run(place, "--data", place / "other")
    plain, other = (load_dataset(place / name).recording for name in ("plain", "other"))
    np.testing.assert_allclose(plain.x, other.x, rtol=1e-5, atol=1e-6)


def test_a_period_that_the_controller_does_not_drive_at_is_allowed_and_said(place, capsys):
    (place / "map.toml").write_text("period_s = 0.04\n" + MAPPING)
    run(place, "--data", place / "data")
    assert load_dataset(place / "data").schema.dt_s == 0.04
    assert "every 25 ms only" in " ".join(capsys.readouterr().out.split())


def test_poses_make_a_data_set_of_the_controllers_own_signals(place, capsys):
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
    run(place, "--data", place / "data")
    dataset = load_dataset(place / "data")
    assert dataset.schema == VEHICLE
    assert dataset.recording.has_poses
    windows = dataset.select("test")
    assert windows.x.shape[1:] == (81, 6)
    np.testing.assert_allclose(windows.x[:, 0, 3], 0.025 * windows.x[:, 0, 0], rtol=0.04)
    assert "do not drive" not in capsys.readouterr().out


def test_a_drive_around_a_track_is_told_against_its_line(place):
    angle = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    write_csv(place / "track.csv", {"x": 30 * np.cos(angle), "y": 30 * np.sin(angle)})
    for seed in range(3):
        made = make_drive(15.0, 0.01, seed)
        way = np.cumsum(made.speed) * 0.01 / 29.0
        spoil(
            place,
            seed,
            x=lambda x, way=way: 29.0 * np.cos(way),
            y=lambda y, way=way: 29.0 * np.sin(way),
            yaw=lambda yaw, way=way: way + np.pi / 2,
        )
    line = 'reference_line = "track.csv"\nclosed = true\n'
    (place / "map.toml").write_text(MAPPING + POSE + line)
    run(place, "--data", place / "data")
    dataset = load_dataset(place / "data")
    assert not dataset.recording.has_poses
    windows = dataset.select("train")
    np.testing.assert_allclose(windows.x[..., 4], 1.0, atol=0.05)
    np.testing.assert_allclose(windows.w, 1 / 30.0, rtol=0.05)
    np.testing.assert_allclose(windows.x[..., 3], 0.025 * windows.x[..., 0] * 30 / 29, rtol=0.02)


def test_a_line_in_another_frame_than_the_poses_is_refused(place):
    angle = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    write_csv(place / "track.csv", {"x": 9e4 + np.cos(angle), "y": np.sin(angle)})
    (place / "map.toml").write_text(MAPPING + POSE + 'reference_line = "track.csv"\n')
    with pytest.raises(DatasetError, match=r"within 15 m of .*track\.csv, found all 1800 periods"):
        run(place)


def test_a_drive_that_leaves_the_line_is_cut_there_and_that_is_said(place, capsys):
    write_csv(place / "track.csv", {"x": np.arange(-50.0, 300.0), "y": np.zeros(350)})
    for seed in range(3):
        way = 0.15 * np.arange(1501)
        spoil(
            place,
            seed,
            x=lambda x, way=way: way,
            y=lambda y: np.where(np.arange(1501) < 800, 1.0, 60.0),
            yaw=lambda yaw: 0.0 * yaw,
        )
    line = 'reference_line = "track.csv"\n[checks]\naccept_units = true\n'
    (place / "map.toml").write_text(MAPPING + POSE + line)
    run(place, "--json", place / "figures.json")
    figures = json.loads((place / "figures.json").read_text())
    assert figures["kept_s"] == pytest.approx(3 * 7.9, abs=0.3)
    assert "reference line" in {finding["about"] for finding in figures["findings"]}


def with_nan(values):
    values[40] = np.nan
    return values


REFUSED = {
    "NaN": (
        {"turn": with_nan},
        r"run_1\.csv, column turn, line 42: expected a number, found none",
    ),
    "time that runs back": (
        {"time": lambda t: np.concatenate([t[:50], t[49:50], t[51:]])},
        r"run_1\.csv, column time, line 52: expected time to increase",
    ),
    "a speed in km/h among logs in m/s": (
        {"speed": lambda v: v * 3.6},
        r"run_1\.csv, from line 2 on: .*km/h taken for m/s",
    ),
    "a yaw rate in deg/s among logs in rad/s": (
        {"turn": np.degrees},
        r"run_1\.csv, column turn, line \d+: expected yaw_rate_radps between -5 and 5 rad/s",
    ),
    "a steering angle in degrees among logs in radians": (
        {"wheel": np.degrees},
        r"run_1\.csv, from line 2 on: .*degrees taken for radians",
    ),
    "a speed that no car has": (
        {"speed": lambda v: v * 20.0},
        r"run_1\.csv, column speed, line \d+: expected vx_mps between -20 and 120 m/s",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_bad_logs_are_refused_with_their_place_and_nothing_is_written(place, what):
    changes, message = REFUSED[what]
    spoil(place, **changes)
    with pytest.raises(DatasetError) as caught:
        run(place, "--data", place / "data", "--json", place / "figures.json")
    assert re.search(message, str(caught.value), re.DOTALL)
    assert not (place / "data").exists()
    assert not (place / "figures.json").exists()


def test_a_suspicion_about_units_may_be_accepted(place, capsys):
    spoil(place, force=lambda f: f / 1000.0)
    (place / "map.toml").write_text(MAPPING + "[checks]\naccept_units = true\n")
    assert run(place, "--data", place / "data") == 0
    assert "a thousand" in " ".join(capsys.readouterr().out.split())


def test_a_constant_input_is_refused_unless_the_mapping_allows_it(place, capsys):
    for seed in range(3):
        spoil(place, seed, force=lambda f: 0.0 * f + 12.0)
    message = r"column force, lines 2 to 1502: expected force_n to move, found 12 N"
    with pytest.raises(DatasetError, match=message):
        run(place, "--data", place / "data")
    text = MAPPING.replace('unit = "N"', 'unit = "N", may_be_constant = true')
    (place / "map.toml").write_text(text)
    assert run(place, "--data", place / "data") == 0
    assert "never moves" in capsys.readouterr().out


def test_an_input_that_rests_in_one_log_only_is_no_constant(place):
    spoil(place, force=lambda f: 0.0 * f)
    assert run(place, "--data", place / "data") == 0


def test_a_period_of_24_ms_is_not_taken_for_25(place):
    (place / "map.toml").write_text(
        MAPPING.replace('column = "time"', 'column = "time"\nperiod_s = 0.025', 1)
    )
    for seed in range(3):
        write_csv(place / "logs" / f"run_{seed}.csv", rounded(make_drive(15.0, 0.024, seed)))
    with pytest.raises(DatasetError, match=r"run_0\.csv, column time, line 3: .*25 ms.*24 ms"):
        run(place, "--data", place / "data")


def test_episodes_of_ten_samples_only_are_refused(place):
    for seed in range(3):
        short = {name: values[:24] for name, values in columns_of(seed).items()}
        write_csv(place / "logs" / f"run_{seed}.csv", short)
    message = r"run_0\.csv, column speed, line 2: .*at least 101 samples at 25 ms, found one of 10"
    with pytest.raises(DatasetError, match=message):
        run(place, "--data", place / "data")


def test_a_short_log_among_long_ones_is_left_out_and_counted(place):
    short = {name: values[:23] for name, values in columns_of(7).items()}
    write_csv(place / "logs" / "short.csv", short)
    run(place, "--data", place / "data", "--json", place / "figures.json")
    assert read_manifest(place / "data" / "manifest.json").rejected_episodes == 1
    assert json.loads((place / "figures.json").read_text())["n_too_short"] == 1


def test_a_truncated_log_is_refused_whatever_the_others_are(place):
    path = place / "logs" / "run_3.npz"
    np.savez(path, **{name: np.array(values) for name, values in columns_of(3).items()})
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(DatasetError, match=r"run_3\.npz.*truncated"):
        run(place, "--data", place / "data")


def test_a_can_log_becomes_the_same_data_set_as_a_table(place):
    """Frames of two messages at different times; what remains is their resolution."""
    run(place, "--data", place / "table")
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
    run(place, "--data", place / "can")
    table, bus = (load_dataset(place / name).recording for name in ("table", "can"))
    np.testing.assert_array_equal(table.first, bus.first)
    np.testing.assert_allclose(bus.x, table.x, atol=2e-3)
    np.testing.assert_allclose(bus.u, table.u, rtol=1e-3, atol=0.6)


def test_a_late_signal_is_reported_with_the_delay_to_write(place, capsys):
    for seed in range(3):
        spoil(place, seed, turn=lambda r: np.concatenate([np.full(32, r[0]), r[:-32]]))
    run(place, "--json", place / "figures.json")
    (finding,) = json.loads((place / "figures.json").read_text())["findings"]
    assert (finding["about"], finding["subject"]) == ("time shift", "yaw_rate_radps")
    assert "delay_s, about 0.3" in finding["says"]
