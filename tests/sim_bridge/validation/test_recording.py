"""Replay of recorded drives: columns, files that are refused, lag, and a car against itself."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.parameters import default_car
from sim_bridge.validation.recording.columns import COMPARED, assign
from sim_bridge.validation.recording.comparison import best_lag, compare
from sim_bridge.validation.recording.recording import Window, load_recording
from sim_bridge.validation.recording.report import doubts

CAR = default_car()
SPEED_MPS = 22.0
EVERY = np.ones(1500, dtype=bool)


def wave(time_s: Array) -> Array:
    return np.sin(3.0 * time_s) + 0.4 * np.sin(7.3 * time_s + 1.0)


# Columns


def test_columns_with_the_names_of_signals_need_no_assignment() -> None:
    titles = ("time_s", "steer_deg", "vx_kmh", "yaw_rate_degps", "comment")
    columns = assign(titles, (), "log.csv")
    assert {column.signal: column.title for column in columns} == {
        "time_s": "time_s",
        "steer_rad": "steer_deg",
        "vx_mps": "vx_kmh",
        "yaw_rate_radps": "yaw_rate_degps",
    }
    factor = next(column.factor for column in columns if column.signal == "vx_mps")
    assert factor == pytest.approx(1.0 / 3.6)


def test_an_assignment_states_unit_and_sign_of_a_column() -> None:
    assignments = ("yaw_rate_degps=-r", "road_wheel_rad=delta", "vx_mps=u")
    columns = {c.title: c for c in assign(("r", "delta", "u"), assignments, "log.csv")}
    assert columns["r"].signal == "yaw_rate_radps"
    assert columns["r"].factor == pytest.approx(-np.pi / 180.0)


def test_all_that_is_wrong_with_the_columns_is_named_at_once() -> None:
    with pytest.raises(ConfigError) as refused:
        assign(("a", "b"), ("speed=a", "vx_mps=c"), "log.csv")
    message = str(refused.value)
    for part in ("log.csv", "speed=a", "'c'", "vx_kmh", "road_wheel_deg", "yaw_rate_radps"):
        assert part in message


def test_a_signal_in_two_columns_is_refused() -> None:
    with pytest.raises(ConfigError, match="yaw_rate_radps: expected one column"):
        assign(("yaw_rate_radps", "yaw_rate_degps", "vx_mps", "steer_rad"), (), "log.csv")


# Files


def columns_of_a_log(n: int = 1000) -> dict[str, Array]:
    time_s = 0.02 * np.arange(n)
    return {
        "time_s": 12.0 + time_s,
        "steer_deg": 20.0 * np.sin(time_s),
        "vx_mps": 20.0 + np.sin(0.3 * time_s),
        "yaw_rate_radps": 0.1 * np.sin(time_s),
    }


def write_csv(path: Path, columns: dict[str, Array], separator: str = ",") -> Path:
    lines = [separator.join(columns)]
    rows = zip(*columns.values(), strict=True)
    lines += [separator.join(f"{value:.9g}" for value in row) for row in rows]
    text = "\n".join(lines) + "\n"
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


@pytest.mark.parametrize("name", ["a.csv", "b.csv.gz", "c.npz", "d.parquet"])
def test_all_formats_give_the_same_recording(tmp_path: Path, name: str) -> None:
    columns, path = columns_of_a_log(), tmp_path / name
    if name.endswith(".npz"):
        np.savez(path, **columns)  # type: ignore[arg-type]
    elif name.endswith(".parquet"):
        pyarrow = pytest.importorskip("pyarrow")
        pytest.importorskip("pyarrow.parquet").write_table(pyarrow.table(columns), path)
    else:
        write_csv(path, columns, ";")
    recording = load_recording(path)
    assert len(recording.time_s) == pytest.approx(1999, abs=1)
    assert not recording.is_road_wheel
    np.testing.assert_allclose(recording.time_s[:3], (0.0, 0.01, 0.02), atol=1e-12)
    expected = np.radians(20.0) * np.sin(recording.time_s)
    np.testing.assert_allclose(recording.steer_rad, expected, atol=1e-4)
    np.testing.assert_allclose(
        recording.signals[0].values, 0.1 * np.sin(recording.time_s), atol=1e-4
    )


def refusal(path: Path, columns: dict[str, Array], **options: float) -> str:
    write_csv(path, columns)
    with pytest.raises(ConfigError) as refused:
        load_recording(path, **options)  # type: ignore[arg-type]
    return str(refused.value)


def test_a_time_that_does_not_increase_is_refused_with_its_sample(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    columns["time_s"][500] = columns["time_s"][499]
    message = refusal(tmp_path / "log.csv", columns)
    assert "increase" in message
    assert "sample 501" in message


def test_a_gap_is_refused_with_its_time(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    columns["time_s"][700:] += 3.0
    assert "gap" in refusal(tmp_path / "log.csv", columns)


def test_values_that_are_no_numbers_are_refused_by_column_and_time(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    columns["yaw_rate_radps"][100:103] = np.nan
    columns["steer_deg"][400] = np.inf
    message = refusal(tmp_path / "log.csv", columns)
    assert "yaw_rate_radps: expected numbers, found nan at 2 s, and 3 such" in message
    assert "steer_deg" in message


def test_a_standing_car_is_refused_and_the_longest_drive_is_named(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    columns["vx_mps"][:100] = 0.0
    columns["vx_mps"][900:] = 0.0
    message = refusal(tmp_path / "log.csv", columns)
    assert "--from-s 2.00 --to-s 17.98" in message
    recording = load_recording(tmp_path / "log.csv", window=Window(2.0, 17.98))
    assert recording.speed_mps.min() > 18.0


def test_kilometres_per_hour_by_mistake_are_suspected(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    columns["vx_mps"] *= 3.6
    assert "vx_kmh" in refusal(tmp_path / "log.csv", columns)


def test_a_log_without_times_needs_a_period(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    del columns["time_s"]
    assert "--period-s" in refusal(tmp_path / "log.csv", columns)
    assert len(load_recording(tmp_path / "log.csv", log_period_s=0.02).time_s) > 1900


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "log.mat").write_bytes(b"MATLAB")
    for name, found in (("log.mat", ".parquet"), ("missing.csv", "missing.csv")):
        with pytest.raises(ConfigError, match=found):
            load_recording(tmp_path / name)
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"no archive")
    with pytest.raises(ConfigError, match="broken"):
        load_recording(broken)


# Comparison


@given(st.floats(-0.4, 0.4), st.floats(0.2, 5.0))
def test_the_lag_of_a_shifted_signal_is_found(lag_s: float, size: float) -> None:
    time_s = 0.01 * np.arange(1500)
    recorded, car = size * wave(time_s - lag_s), size * wave(time_s)
    found_s, remaining = best_lag(recorded, car, 0.01, EVERY)
    assert found_s == pytest.approx(lag_s, abs=2e-3)
    error = float(np.sqrt(np.mean((recorded - car)[50:-50] ** 2)))
    assert remaining * error < 0.01 * size


def test_the_error_at_the_lag_is_never_above_the_error_without_it() -> None:
    """Also if the recording is worse in the middle, where all lags can be compared."""
    recorded = wave(0.01 * np.arange(1500))
    car = recorded.copy()
    car[100:-100] *= 1.2
    figures = compare("a log", "yaw_rate_radps", recorded, car, 0.01, EVERY)
    assert figures.error_at_lag_percent <= figures.error_percent


@pytest.mark.parametrize(
    ("scale", "remark"),
    [
        (-1.0, "gain negative: wrong sign?"),
        (0.0175, "gain far from 1: wrong unit?"),
        (3.6, "gain far from 1: wrong unit?"),
    ],
)
def test_a_wrong_sign_or_unit_of_a_column_is_named(scale: float, remark: str) -> None:
    recorded = wave(0.01 * np.arange(1500))
    assert remark in doubts(compare("a log", "roll_rad", recorded, scale * recorded, 0.01, EVERY))
    assert doubts(compare("a log", "roll_rad", recorded, 1.2 * recorded, 0.01, EVERY)) == ()


def test_a_lag_at_the_end_of_the_search_is_named() -> None:
    ramp = 0.01 * np.arange(1500)
    assert "lag at the end of its search" in doubts(
        compare("a log", "roll_rad", ramp, ramp + 1.0, 0.01, EVERY)
    )


def test_each_compared_signal_has_the_words_of_an_axis() -> None:
    pytest.importorskip("plotly")
    from sim_bridge.validation.plots.recording import TITLES

    assert set(COMPARED) < set(TITLES)


def test_error_and_gain_of_a_signal_that_is_too_large() -> None:
    recorded = wave(0.01 * np.arange(1500))
    figures = compare("a log", "yaw_rate_radps", recorded, 1.2 * recorded, 0.01, EVERY)
    assert figures.error_percent == pytest.approx(20.0)
    assert figures.gain == pytest.approx(1.2)
    assert figures.lag_s == pytest.approx(0.0, abs=1e-3)


def test_samples_that_are_left_out_have_no_influence() -> None:
    recorded = wave(0.01 * np.arange(1500))
    car = recorded.copy()
    car[600:700] += 100.0
    among = EVERY.copy()
    among[600:700] = False
    figures = compare("a log", "yaw_rate_radps", recorded, car, 0.01, among)
    assert figures.error_percent == pytest.approx(0.0, abs=1e-9)
