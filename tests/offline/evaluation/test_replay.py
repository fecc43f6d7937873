"""Replay of recorded drives: logs, refusals, lag, and a car against itself."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from offline.commands.replay import doubts, replay
from offline.evaluation.replay import Comparison, compare, replay_drive
from offline.logs.recorded_drive import RecordedDrive
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import RtControllerError
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.parameters import default_car, with_road_friction
from sim_bridge.validation.driver_model import SpeedControl
from sim_bridge.validation.run import Observation, cruising_throttle, run_driver

CAR = default_car()
TWO_ANGLES = 'road_wheel_rad = { column = "pedal", unit = "deg"'
MAY_BE_MISSING = '"%", missing = "skip" }'
EVERY = np.ones(1500, dtype=bool)
TIME_S = 0.01 * np.arange(1500)


MAPPING = """
time = { column = "t", unit = "ms" }
[states]
vx_mps = { column = "v", unit = "km/h" }
yaw_rate_radps = { column = "r", unit = "deg/s", sign = -1 }
[inputs]
steer_rad = { column = "wheel", unit = "deg" }
throttle = { column = "pedal", unit = "%" }
"""


def columns_of_a_log(n: int = 1000) -> dict[str, Array]:
    time_s = 0.02 * np.arange(n)
    return {
        "t": 12e3 + 1e3 * time_s,
        "wheel": 20.0 * np.sin(time_s),
        "v": 3.6 * (20.0 + np.sin(0.3 * time_s)),
        "r": -np.degrees(0.1 * np.sin(time_s)),
        "pedal": 20.0 + np.sin(time_s),
    }


def changed(name: str, rows: slice, value: float) -> dict[str, Array]:
    columns = columns_of_a_log()
    columns[name][rows] = value
    return columns


def run(folder: Path, columns: dict[str, Array], mapping: str = MAPPING) -> list[dict[str, Any]]:
    """The figures of the command, from the file that it writes."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    (folder / "map.toml").write_text(mapping)
    replay(folder / "map.toml", [folder / "log.csv"], json_file=folder / "figures.json")
    found: list[dict[str, Any]] = json.loads((folder / "figures.json").read_text("utf-8"))
    return found


@pytest.mark.parametrize(
    ("columns", "replaced", "words"),
    [
        ({}, ("vx_mps", "u_mps"), "expected the speed, vx_mps"),
        ({}, ("steer_rad", "angle_rad"), "either steer_rad or road_wheel_rad, found none"),
        ({}, ('throttle = { column = "pedal", unit = "%"', TWO_ANGLES), "found road_wheel_rad and"),
        ({}, ("yaw_rate_radps", "other_radps"), "one of yaw_rate_radps, vy_mps"),
        (changed("t", slice(500, 501), 21980.0), ("", ""), "increase"),
        (changed("v", slice(0, 800), 0.0), ("", ""), "at least 5 s without gap at 2 to 70 m/s"),
        (changed("v", slice(100, None, 200), 220.0), ("", ""), "found 3.96 s"),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_with_the_reason(tmp_path, columns, replaced, words):
    with pytest.raises(RtControllerError, match=re.escape(words)):
        run(tmp_path, columns or columns_of_a_log(), MAPPING.replace(*replaced))


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


def test_every_driven_stretch_is_compared_in_the_units_of_the_mapping(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pedal is unknown for some time, which does not matter; the car stops in between."""
    columns = changed("pedal", slice(100, 103), np.nan)
    columns["v"][440:460] = 0.0
    rate, yaw_rate, *second = run(tmp_path, columns, MAPPING.replace('"%" }', MAY_BE_MISSING))
    assert (rate["signal"], yaw_rate["signal"]) == ("speed_rate_mps2", "yaw_rate_radps")
    assert (rate["recording"], second[0]["recording"]) == (
        "log.csv from 0.0 s",
        "log.csv from 9.2 s",
    )
    assert yaw_rate["rms_recorded"] == pytest.approx(0.07, abs=0.005)
    assert yaw_rate["gain"] > 0.5
    assert {"recording", "rms_recorded", "rms_error", "lag_s", "spins", "compared_s"} <= set(rate)
    (again,) = run(tmp_path, columns_of_a_log(), MAPPING.replace(", sign = -1", ""))[1:]
    assert again["gain"] < -0.5
    assert "wrong sign?" in " ".join(capsys.readouterr().out.split())
