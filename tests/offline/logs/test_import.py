"""`offline-import` makes a data set of logs, reports what is unusual, and refuses bad logs."""

import json
import re

import numpy as np
import pytest
from made_logs import (
    MAPPING,
    POSE,
    change_log,
    columns_of,
    make_drive,
    make_place,
    rounded,
    run_import,
    write_csv,
)

from offline.commands.import_logs import import_logs
from offline.data.dataset import load_dataset
from offline.data.manifest import Imported, read_manifest
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import VEHICLE

ACCEPTED = "[checks]\naccept_units = true\n"
LINE = POSE + 'reference_line = "track.csv"\n'


@pytest.fixture
def place(tmp_path):
    return make_place(tmp_path)


def figures_of(place, *options):
    run_import(place, *options, "--json", place / "figures.json")
    return json.loads((place / "figures.json").read_text())


def test_logs_become_a_data_set_that_loads(place, capsys):
    short = {name: values[:23] for name, values in columns_of(7).items()}
    write_csv(place / "logs" / "short.csv", short)
    figures = figures_of(place, "--data", place / "data")
    dataset = load_dataset(place / "data")
    assert dataset.schema.state_names == ("vx_mps", "vy_mps", "yaw_rate_radps")
    assert dataset.schema.input_names == ("road_wheel_rad", "force_n")
    windows = dataset.select("train")
    assert windows.x.shape == (7, 81, 3)
    assert windows.w.shape == (7, 80, 0)
    assert windows.past.shape == (7, 20, 5)
    made = make_drive(15.0, 0.01, int(dataset.episodes("train")[0]))
    expected = np.interp(0.5 + 0.025 * np.arange(81), made.time, made.turn)
    np.testing.assert_allclose(windows.x[0, :, 2], expected, atol=1e-3)
    assert figures["sha256"] == dataset.sha256
    assert figures["n_slices"] == {"train": 7, "validation": 7, "test": 7}
    assert [each["file"] for each in figures["episodes"]] == [f"run_{k}.csv" for k in range(3)]
    assert figures["n_too_short"] == 1
    speed = next(each for each in figures["ranges"] if each["name"] == "vx_mps")
    values = np.concatenate([columns_of(k)["speed"] for k in range(3)])
    assert speed["unit"] == "m/s"
    assert (speed["lowest"], speed["median"]) == pytest.approx(
        (values.min(), np.median(values)), abs=0.01
    )
    manifest = read_manifest(place / "data" / "manifest.json")
    assert manifest.rejected_episodes == 1
    assert isinstance(manifest.origin, Imported)
    assert [file.name for file in manifest.origin.files][:3] == [f"run_{k}.csv" for k in range(3)]
    assert manifest.origin.mapping == MAPPING
    before, _, after = " ".join(capsys.readouterr().out.split()).partition("Next,")
    assert "not the simulated one: rt-controller --bus virtual drives another car" in before
    assert "offline-train" in after


def test_the_same_logs_give_the_same_numbers_and_are_replaced_only_with_the_option(place):
    first = figures_of(place, "--data", place / "data")
    with pytest.raises(ConfigError, match="--replace"):
        run_import(place, "--data", place / "data")
    assert figures_of(place, "--data", place / "data", "--replace") == first


def test_the_car_of_the_mapping_goes_into_the_data_set(place):
    car = (
        "[car]\nwheelbase_m = 3.2\nrear_axle_m = 1.5\nsteering_ratio = 16.0\nlargest_brake_n = 90\n"
    )
    (place / "map.toml").write_text(f"{MAPPING}{car}")
    run_import(place, "--data", place / "known")
    car = load_dataset(place / "known").car
    assert car.geometry == SteeringGeometry(3.2, 1.5, 16.0)
    assert car.own_values == {"largest_brake_n": 90.0}


def test_without_a_folder_the_logs_are_only_checked(place, capsys):
    before = sorted(place.rglob("*"))
    assert run_import(place) == 0
    assert sorted(place.rglob("*")) == before
    assert "3 episodes" in capsys.readouterr().out


def test_another_period_than_that_of_the_controller_is_allowed_and_reported(place, capsys):
    (place / "map.toml").write_text("period_s = 0.04\n" + MAPPING)
    run_import(place, "--data", place / "data")
    assert load_dataset(place / "data").schema.dt_s == 0.04
    assert "every 25 ms only" in " ".join(capsys.readouterr().out.split())


def test_poses_give_a_data_set_with_the_signals_of_the_controller(place, capsys):
    states, _, _ = MAPPING.partition("[inputs]")
    inputs = """[inputs]
throttle = { column = "force", unit = "%", factor = 0.005, sampling = "held" }
brake_n = { column = "side", unit = "N", quantity = "other" }
steer_rad = { column = "wheel", unit = "rad", factor = 15.0 }
"""
    (place / "map.toml").write_text(states + inputs + POSE)
    run_import(place, "--data", place / "data")
    dataset = load_dataset(place / "data")
    assert dataset.schema == VEHICLE
    assert dataset.recording.has_poses
    windows = dataset.select("test")
    assert windows.x.shape[1:] == (81, 6)
    np.testing.assert_allclose(windows.x[:, 0, 3], 0.025 * windows.x[:, 0, 0], rtol=0.04)
    assert "do not drive" not in capsys.readouterr().out


def jump(values):
    values[700:] += 9.0
    return values


def without_rows(values):
    return np.delete(values, slice(300, 400))


ALL = ("time", *columns_of(0))


@pytest.mark.parametrize(
    ("changes", "extra", "check", "subject", "words"),
    [
        (dict.fromkeys(ALL, without_rows), "", "gaps", "run_1.csv", "1.01 s .* vx_mps, line 302"),
        (dict.fromkeys(ALL, lambda v: v[::4]), "", "rate", "vx_mps, ", "every 40 ms"),
        ({"speed": jump}, "", "jumps", "vx_mps", "1 increments"),
        ({"force": lambda f: f / 1e3}, ACCEPTED, "units", "run_1.csv", "a thousand"),
        (
            {"x": lambda x: 0.15 * np.arange(1501.0), "yaw": lambda yaw: 0.0 * yaw}
            | {"y": lambda y: np.where(np.arange(1501) < 800, 1.0, 60.0)},
            LINE + ACCEPTED,
            *("reference line", "run_1.csv", "farthest_m"),
        ),
    ],
)
def test_what_is_unusual_is_reported_with_its_place(place, changes, extra, check, subject, words):
    write_csv(place / "track.csv", {"x": np.arange(-50.0, 300.0), "y": np.zeros(350)})
    (place / "map.toml").write_text(MAPPING + extra)
    for seed in range(3) if "x" in changes else (1,):
        change_log(place, seed, **changes)
    issues = [each for each in figures_of(place)["issues"] if each["check"] == check]
    assert any(subject in each["subject"] for each in issues)
    assert any(re.search(words, each["message"]) for each in issues)


def far_line(place):
    angle = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    write_csv(place / "track.csv", {"x": 9e4 + np.cos(angle), "y": np.sin(angle)})
    (place / "map.toml").write_text(MAPPING + LINE)


def truncated(place):
    path = place / "logs" / "run_3.npz"
    np.savez(path, **{name: np.array(values) for name, values in columns_of(3).items()})
    path.write_bytes(path.read_bytes()[:5000])


def too_short(place):
    for seed in range(3):
        short = {name: values[:24] for name, values in columns_of(seed).items()}
        write_csv(place / "logs" / f"run_{seed}.csv", short)


def constant(place):
    for seed in range(3):
        change_log(place, seed, force=lambda f: 0.0 * f + 12.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda place: change_log(place, speed=lambda v: v * 3.6), r"run_1\.csv: .*km/h"),
        (lambda place: change_log(place, turn=np.degrees), r"run_1\.csv, column turn, line \d+"),
        (constant, r"column force, lines 2 to 1502"),
        (far_line, r"track\.csv.*farthest_m"),
        (too_short, r"run_0\.csv, column speed, line 2: .*101 samples"),
        (truncated, r"run_3\.npz.*truncated"),
    ],
)
def test_bad_logs_are_refused_with_their_place_and_nothing_is_written(place, change, message):
    change(place)
    with pytest.raises(DatasetError) as caught:
        run_import(place, "--data", place / "data", "--json", place / "figures.json")
    assert re.search(message, str(caught.value), re.DOTALL)
    assert not (place / "data").exists()
    assert not (place / "figures.json").exists()


def other_ending_and_digits(place):
    lines = (place / "logs" / "run_1.csv").read_text().replace("\r", "").splitlines()
    (place / "logs" / "copy.csv").write_text("# exported again\n" + "\r\n".join(lines) + "\r\n")


def other_format(place):
    np.savez(place / "logs" / "copy.npz", **{k: np.array(v) for k, v in columns_of(1).items()})


def part_of_it(place):
    columns = {name: values[700:1100] for name, values in columns_of(1).items()}
    columns["time"] = [t_s + 100.0 for t_s in columns["time"]]
    write_csv(place / "logs" / "copy.csv", columns)


def with_other_ends(place):
    other = columns_of(1)
    for name, values in columns_of(9).items():
        if name != "time":
            other[name][:500], other[name][900:] = values[:500], values[900:]
    write_csv(place / "logs" / "copy.csv", other)


@pytest.mark.parametrize(
    "add", [other_ending_and_digits, other_format, part_of_it, with_other_ends]
)
def test_logs_with_the_same_samples_are_named_and_make_no_data_set(place, capsys, add):
    add(place)
    (said,) = figures_of(place)["repeated"]
    names = ("run_1.csv", "copy.")
    assert all(name in said for name in names)
    assert f"note: {said}" in capsys.readouterr().out
    with pytest.raises(DatasetError, match="Leave one out") as refused:
        run_import(place, "--data", place / "data")
    assert all(name in str(refused.value) for name in names)
    assert not (place / "data").exists()
    (place / "map.toml").write_text(MAPPING + "[checks]\naccept_repeated = true\n")
    run_import(place, "--data", place / "data")
    assert (place / "data").exists()


def test_drives_with_one_signal_in_common_are_different(place):
    other = columns_of(9)
    write_csv(place / "logs" / "other.csv", {**columns_of(1), "turn": other["turn"]})
    (place / "map.toml").write_text(f"{MAPPING}{ACCEPTED}")
    assert figures_of(place)["repeated"] == []


def test_a_constant_input_is_accepted_in_one_log_or_if_the_mapping_allows_it(place):
    change_log(place, force=lambda f: 0.0 * f)
    assert figures_of(place)["constant"] == []
    constant(place)
    text = MAPPING.replace('unit = "N"', 'unit = "N", may_be_constant = true')
    (place / "map.toml").write_text(text)
    assert figures_of(place)["constant"] == ["force_n"]


def test_a_folder_gives_its_logs_sorted_without_its_reference_line(place):
    for name in ("notes.md", "car.dbc", "words.txt"):
        (place / "logs" / name).write_text("")
    write_csv(place / "logs" / "track.csv", {"x": np.arange(-50.0, 300.0), "y": np.zeros(350)})
    write_csv(place / "logs" / "a.CSV", rounded(make_drive(15.0, 0.01, 5)))
    line = LINE.replace("track", "logs/track") + "farthest_m = 1e4\n"
    (place / "map.toml").write_text(MAPPING + line + ACCEPTED)
    names = [each["name"] for each in figures_of(place)["files"]]
    assert names == ["a.CSV", "run_0.csv", "run_1.csv", "run_2.csv"]


@pytest.mark.parametrize(
    ("places", "error", "message"),
    [
        (["empty"], DatasetError, "empty: expected logs .* found a folder without any"),
        (["none.csv"], ConfigError, r"none\.csv: expected a log or a folder"),
        (["empty/drive.xlsx"], ConfigError, r"drive\.xlsx: expected a log of a known kind"),
        (["logs", "logs/run_1.csv"], ConfigError, r"found twice: run_1\.csv"),
    ],
)
def test_places_without_logs_are_refused(place, places, error, message):
    (place / "empty").mkdir()
    (place / "empty" / "drive.xlsx").write_text("")
    with pytest.raises(error, match=message):
        import_logs(place / "map.toml", [place / each for each in places], None, replace=False)
