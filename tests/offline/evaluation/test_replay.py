"""Replay of recorded drives: logs, refusals, lag, and a car against itself."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from offline.commands.replay import doubts, replay
from offline.evaluation.replay import Comparison, compare, replay_drive
from offline.logs.recorded_drive import RecordedDrive, Window, load_drive
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import default_car, with_road_friction
from sim_bridge.validation.driver_model import SpeedControl
from sim_bridge.validation.run import Observation, cruising_throttle, run_driver

CAR = default_car()
EVERY = np.ones(1500, dtype=bool)
TIME_S = 0.01 * np.arange(1500)


def columns_of_a_log(n: int = 1000) -> dict[str, Array]:
    time_s = 0.02 * np.arange(n)
    return {
        "time_s": 12.0 + time_s,
        "steer_deg": 20.0 * np.sin(time_s),
        "vx_mps": 20.0 + np.sin(0.3 * time_s),
        "yaw_rate_radps": 0.1 * np.sin(time_s),
    }


def write_csv(path: Path, columns: dict[str, Array], separator: str = ",") -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [separator.join(columns)]
    lines += [separator.join(f"{value:.9g}" for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_log_is_read_with_the_units_in_its_names(tmp_path):
    drive = load_drive(write_csv(tmp_path / "a.csv", columns_of_a_log(), ";"))
    time_s = 0.01 * np.arange(len(drive.steer_rad))
    assert len(time_s) == pytest.approx(1999, abs=1)
    assert not drive.is_road_wheel
    np.testing.assert_allclose(drive.steer_rad, np.radians(20.0) * np.sin(time_s), atol=1e-4)
    np.testing.assert_allclose(drive.signals["yaw_rate_radps"], 0.1 * np.sin(time_s), atol=1e-4)


def test_an_assignment_states_unit_and_sign_of_a_column(tmp_path: Path) -> None:
    columns = columns_of_a_log()
    factors = {"t": 1e3, "delta": 1.0, "u": 3.6, "r": -np.degrees(1.0)}
    own = {
        name: factor * values
        for (name, factor), values in zip(factors.items(), columns.values(), strict=True)
    }
    assignments = ("time_ms=t", "road_wheel_deg=delta", "vx_kmh=u", "yaw_rate_degps=-r")
    drive = load_drive(write_csv(tmp_path / "own.csv", own), assignments)
    same = load_drive(write_csv(tmp_path / "same.csv", columns))
    assert drive.is_road_wheel
    np.testing.assert_allclose(drive.steer_rad, same.steer_rad, atol=1e-6)
    np.testing.assert_allclose(drive.speed_mps, same.speed_mps, atol=1e-6)
    np.testing.assert_allclose(
        drive.signals["yaw_rate_radps"], same.signals["yaw_rate_radps"], atol=1e-6
    )


def without(name: str) -> dict[str, Array]:
    return {key: values for key, values in columns_of_a_log().items() if key != name}


def changed(name: str, rows: slice, value: float) -> dict[str, Array]:
    columns = columns_of_a_log()
    columns[name][rows] = value
    return columns


@pytest.mark.parametrize(
    ("columns", "assignments", "words"),
    [
        (columns_of_a_log(), ("speed=vx_mps",), "speed=vx_mps"),
        (columns_of_a_log(), ("vx_mps=c",), "'c'"),
        (without("time_s"), (), "'time_s'"),
        (without("vx_mps"), (), "'vx_mps' or 'vx_kmh'"),
        (without("steer_deg"), (), "steering wheel"),
        (without("yaw_rate_radps"), (), "yaw_rate_degps"),
        (changed("time_s", slice(500, 501), 21.98), (), "increase"),
        (changed("time_s", slice(0, 1), 1.0), (), "gap above 0.5 s"),
        (changed("yaw_rate_radps", slice(100, 103), np.nan), (), "nan at 2 s"),
        (changed("vx_mps", slice(0, 100), 0.0), (), "--from-s"),
        (changed("vx_mps", slice(0, None), 72.0), (), "usable part: none"),
        (
            {**without("yaw_rate_radps"), "r (rad/s)": columns_of_a_log()["yaw_rate_radps"]},
            *(("yaw_rate_degps=r",), "column r"),
        ),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_with_the_reason(
    tmp_path, columns, assignments, words
):
    log = write_csv(tmp_path / "log.csv", columns)
    with pytest.raises(RtControllerError, match=re.escape(words)):
        load_drive(log, assignments)


@pytest.mark.parametrize("kept", [slice(0, 300), slice(500, None), slice(0, 0)])
def test_a_channel_that_is_not_known_all_the_time_is_refused(tmp_path: Path, kept: slice) -> None:
    mdf, signal = (pytest.importorskip("asammdf").MDF(), pytest.importorskip("asammdf").Signal)
    columns = columns_of_a_log()
    time_s = columns.pop("time_s")
    for name, values in columns.items():
        part = kept if name == "yaw_rate_radps" else slice(None)
        mdf.append([signal(values[part], time_s[part], name=name)])
    mdf.save(tmp_path / "log.mf4")
    mdf.close()
    with pytest.raises(ConfigError, match=r"column yaw_rate_radps: expected no gap above 0\.5 s"):
        load_drive(tmp_path / "log.mf4")


def test_a_part_of_a_log_and_a_log_without_times_can_be_used(tmp_path: Path) -> None:
    log = write_csv(tmp_path / "log.csv", changed("vx_mps", slice(0, 100), 0.0))
    assert load_drive(log, window=Window(2.0, 15.0)).speed_mps.min() > 18.0
    with pytest.raises(ConfigError, match="at least 5 s"):
        load_drive(log, window=Window(2.0, 4.0))
    plain = write_csv(tmp_path / "plain.csv", without("time_s"))
    assert len(load_drive(plain, period_s=0.02).speed_mps) > 1900


def wave(time_s: Array) -> Array:
    return np.sin(3.0 * time_s) + 0.4 * np.sin(7.3 * time_s + 1.0)


def figures(recorded: Array, car: Array, among: np.ndarray = EVERY) -> Comparison:
    return compare("a log", "roll_rad", recorded, car, among)


@given(st.floats(-0.4, 0.4), st.floats(0.2, 5.0))
def test_the_lag_of_a_shifted_signal_is_found(lag_s: float, size: float) -> None:
    found = figures(size * wave(TIME_S - lag_s), size * wave(TIME_S))
    assert found.lag_s == pytest.approx(lag_s, abs=2e-3)
    assert found.error_at_lag_percent <= min(found.error_percent, 1.0) + 1e-9


@pytest.mark.parametrize(
    ("car", "remark"),
    [
        (-wave(TIME_S), "gain negative: wrong sign?"),
        (0.0175 * wave(TIME_S), "gain far from 1: wrong unit?"),
        (3.6 * wave(TIME_S), "gain far from 1: wrong unit?"),
        (1.2 * wave(TIME_S), None),
    ],
)
def test_a_wrong_sign_or_unit_of_a_column_is_named(car: Array, remark: str | None) -> None:
    found = doubts(figures(wave(TIME_S), car))
    assert remark in found if remark else found == ()
    assert "lag at the end of its search" in doubts(figures(TIME_S, TIME_S + 1.0))


def steer_rad(time_s: float) -> float:
    return 0.5 * float(np.sin(2.0 * time_s) + 0.4 * np.sin(5.0 * time_s))


@pytest.fixture(scope="module")
def drive() -> RecordedDrive:
    """The shipped car at a varying speed."""
    speed = SpeedControl(22.0, cruising_throttle(CAR, 22.0), 0.01)

    def driver(now: Observation) -> ControlInput:
        is_braking = 6.0 < now.time_s < 7.5
        throttle = speed.throttle(now.vx_mps + 2.0 * float(np.sin(0.5 * now.time_s)))
        pedals = (0.0, 40.0) if is_braking else (throttle, 0.0)
        return ControlInput(*pedals, steer_rad(now.time_s + 0.005))

    run = run_driver(CAR, 22.0, driver, 16.0, 0.01)
    signals = {
        "yaw_rate_radps": run.motion[:, 2],
        "vy_mps": run.motion[:, 1],
        "ay_mps2": run.column("ay_mps2"),
        "roll_rad": run.column("roll_rad"),
    }
    steer = np.array([steer_rad(time_s) for time_s in run.time_s.tolist()])
    return RecordedDrive("a drive", run.speed_mps, steer, False, signals)


def errors(found: list[Comparison]) -> list[float]:
    """In percent, without the rate of the speed."""
    return [one.error_percent for one in found[1:]]


def test_a_drive_of_the_car_itself_is_reproduced(drive: RecordedDrive) -> None:
    found = replay_drive(CAR, drive)
    assert [one.signal for one in found] == ["speed_rate_mps2", *drive.signals]
    assert found[0].spins == 0
    yaw_rate, vy, ay, roll = errors(found)
    assert max(yaw_rate, ay, roll) < 2.0
    assert vy < 6.0  # small, and sensitive to the pedals, which are not those of the drive
    assert found[0].error_percent < 40.0
    np.testing.assert_allclose([one.lag_s for one in found[1:]], 0.0, atol=0.012)
    wheels = RecordedDrive(
        "wheels", drive.speed_mps, drive.steer_rad / CAR.steering.ratio, True, drive.signals
    )
    assert errors(replay_drive(CAR, wheels)) == pytest.approx(errors(found))


def test_another_car_has_a_larger_error(drive: RecordedDrive) -> None:
    body = CAR.body._replace(front_axle_m=1.25, rear_axle_m=1.66, yaw_inertia_kgm2=3500.0)
    assert min(errors(replay_drive(CAR._replace(body=body), drive))[:2]) > 10.0


def test_a_car_that_spins_is_started_again_and_its_start_is_left_out(drive: RecordedDrive) -> None:
    hard = RecordedDrive("hard", 1.6 * drive.speed_mps, 4.0 * drive.steer_rad, False, drive.signals)
    found = replay_drive(with_road_friction(CAR, 0.4), hard)
    assert found[0].spins > 0
    assert found[0].compared_s <= 16.01 - 2.0 - 2.0


def test_the_command_prints_and_writes_the_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_csv(tmp_path / "log.csv", columns_of_a_log())
    replay([log], column=("yaw_rate_radps=-yaw_rate_radps",), json_file=tmp_path / "figures.json")
    rate, yaw_rate = json.loads((tmp_path / "figures.json").read_text("utf-8"))
    assert (rate["signal"], yaw_rate["signal"]) == ("speed_rate_mps2", "yaw_rate_radps")
    assert yaw_rate["gain"] < 0.0
    assert {"recording", "rms_recorded", "rms_error", "lag_s", "spins", "compared_s"} <= set(rate)
    assert "wrong sign?" in " ".join(capsys.readouterr().out.split())
