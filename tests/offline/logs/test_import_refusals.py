"""`offline-import` refuses bad logs with their place, and writes nothing."""

import re

import numpy as np
import pytest
from made_import import change_log, columns_of, make_place, run_import
from made_logs import MAPPING, POSE, make_drive, rounded, write_csv

from rt_controller.contract.errors import ConfigError, DatasetError


@pytest.fixture
def place(tmp_path):
    return make_place(tmp_path)


def test_an_existing_data_set_is_replaced_only_with_the_option(place):
    run_import(place, "--data", place / "data")
    with pytest.raises(ConfigError, match="--replace"):
        run_import(place, "--data", place / "data")
    assert run_import(place, "--data", place / "data", "--replace") == 0


def test_a_line_in_another_frame_than_the_poses_is_refused(place):
    angle = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    write_csv(place / "track.csv", {"x": 9e4 + np.cos(angle), "y": np.sin(angle)})
    (place / "map.toml").write_text(MAPPING + POSE + 'reference_line = "track.csv"\n')
    with pytest.raises(DatasetError, match=r"within 15 m of .*track\.csv, found all 1800 periods"):
        run_import(place)


def with_nan(values):
    values[40] = np.nan
    return values


REFUSED = {
    "NaN": (
        {"turn": with_nan},
        r"run_1\.csv, column turn, line 42: expected a number, found none",
    ),
    "time that runs backwards": (
        {"time": lambda t: np.concatenate([t[:50], t[49:50], t[51:]])},
        r"run_1\.csv, column time, line 52: expected time to increase",
    ),
    "a speed in km/h among logs in m/s": (
        {"speed": lambda v: v * 3.6},
        r"run_1\.csv, column speed, from line 2 on: .*km/h taken for m/s",
    ),
    "a yaw rate in deg/s among logs in rad/s": (
        {"turn": np.degrees},
        r"run_1\.csv, column turn, line \d+: expected yaw_rate_radps between -5 and 5 rad/s",
    ),
    "a steering angle in degrees among logs in radians": (
        {"wheel": np.degrees},
        r"run_1\.csv, column speed, from line 2 on: .*degrees taken for radians",
    ),
    "a speed beyond the limits": (
        {"speed": lambda v: v * 20.0},
        r"run_1\.csv, column speed, line \d+: expected vx_mps between -20 and 120 m/s",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_bad_logs_are_refused_with_their_place_and_nothing_is_written(place, what):
    changes, message = REFUSED[what]
    change_log(place, **changes)
    with pytest.raises(DatasetError) as caught:
        run_import(place, "--data", place / "data", "--json", place / "figures.json")
    assert re.search(message, str(caught.value), re.DOTALL)
    assert not (place / "data").exists()
    assert not (place / "figures.json").exists()


def test_suspected_units_can_be_accepted(place, capsys):
    change_log(place, force=lambda f: f / 1000.0)
    (place / "map.toml").write_text(MAPPING + "[checks]\naccept_units = true\n")
    assert run_import(place, "--data", place / "data") == 0
    assert "a thousand" in " ".join(capsys.readouterr().out.split())


def test_a_constant_input_is_refused_unless_the_mapping_allows_it(place, capsys):
    for seed in range(3):
        change_log(place, seed, force=lambda f: 0.0 * f + 12.0)
    message = r"column force, lines 2 to 1502: expected force_n to change, found 12 N"
    with pytest.raises(DatasetError, match=message):
        run_import(place, "--data", place / "data")
    text = MAPPING.replace('unit = "N"', 'unit = "N", may_be_constant = true')
    (place / "map.toml").write_text(text)
    assert run_import(place, "--data", place / "data") == 0
    assert "constant, as the mapping allows" in " ".join(capsys.readouterr().out.split())


def test_an_input_that_is_constant_in_one_log_only_is_accepted(place):
    change_log(place, force=lambda f: 0.0 * f)
    assert run_import(place, "--data", place / "data") == 0


def test_rows_every_24_ms_are_refused_where_25_ms_is_given(place):
    (place / "map.toml").write_text(
        MAPPING.replace('column = "time"', 'column = "time"\nperiod_s = 0.025', 1)
    )
    for seed in range(3):
        write_csv(place / "logs" / f"run_{seed}.csv", rounded(make_drive(15.0, 0.024, seed)))
    with pytest.raises(DatasetError, match=r"run_0\.csv, column time, line 3: .*25 ms.*24 ms"):
        run_import(place, "--data", place / "data")


def test_what_was_not_checked_is_said(place, capsys):
    run_import(place)
    printed = " ".join(capsys.readouterr().out.split())
    assert "Not checked, because nothing in the logs confirms it: unit of vx_mps (" in printed


def test_logs_with_too_short_episodes_only_are_refused(place):
    for seed in range(3):
        short = {name: values[:24] for name, values in columns_of(seed).items()}
        write_csv(place / "logs" / f"run_{seed}.csv", short)
    message = r"run_0\.csv, column speed, line 2: .*at least 101 samples at 25 ms, found one of 10"
    with pytest.raises(DatasetError, match=message):
        run_import(place, "--data", place / "data")


def test_one_truncated_log_is_enough_to_refuse_all(place):
    path = place / "logs" / "run_3.npz"
    np.savez(path, **{name: np.array(values) for name, values in columns_of(3).items()})
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(DatasetError, match=r"run_3\.npz.*truncated"):
        run_import(place, "--data", place / "data")
