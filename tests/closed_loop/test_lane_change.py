"""The shipped models drive the paper's double lane change, over a bus, in lockstep."""

import json
from pathlib import Path

import pytest

from rt_controller.cli import app
from rt_controller.session import shipped_model


def drive(tmp_path: Path, model: str, *options: str, pace: str = "lockstep") -> dict:
    summary = tmp_path / "summary.json"
    command = f"--bus virtual --pace {pace} --quiet --channel {tmp_path.name}"
    files = ["--model", str(shipped_model(model)), "--json", str(summary)]
    with pytest.raises(SystemExit) as ended:
        app.meta([*command.split(), *files, *options])
    assert ended.value.code == 0
    return json.loads(summary.read_text())


@pytest.mark.parametrize("model", ["mdk-net", "mdk-net-paper"])
def test_a_shipped_network_stays_on_its_path(tmp_path: Path, model: str) -> None:
    figures = drive(tmp_path, model)
    assert figures["ey_rms_m"] <= 0.10
    assert figures["ey_peak_m"] <= 0.30
    assert figures["vx_rms_mps"] <= 0.5
    assert figures["ticks"] >= 400
    assert figures["final_mode"] == "STANDBY"
    assert figures["qp_iterations"]["max"] <= 16


def test_a_linear_model_drives_through_the_same_code(tmp_path: Path) -> None:
    figures = drive(tmp_path, "lti")
    assert figures["model"].startswith("lti")
    assert figures["ey_peak_m"] <= 1.0


def test_a_network_that_knows_the_speed_drives_better_far_from_the_middle_of_it(
    tmp_path: Path,
) -> None:
    """What the wheel does depends on the speed; a linear model has one answer for all speeds."""
    network, linear = (
        drive(tmp_path, model, "--scenario", "lane_change_120") for model in ("mdk-net", "lti")
    )
    assert network["ey_rms_m"] <= 0.10
    assert network["ey_rms_m"] < 0.5 * linear["ey_rms_m"]


def test_a_lifted_reference_drives_too(tmp_path: Path) -> None:
    figures = drive(tmp_path, "mdk-net-paper", "--mpc.latent-weight", "0.001")
    assert figures["ey_peak_m"] <= 0.5


def test_the_same_run_twice_gives_the_same_frames(tmp_path: Path) -> None:
    logs = [tmp_path / f"{name}.log" for name in ("first", "second")]
    for log in logs:
        drive(tmp_path, "mdk-net", "--record", str(log))
    assert logs[0].stat().st_size > 100_000
    assert logs[0].read_bytes() == logs[1].read_bytes()


def test_every_figure_of_the_summary_is_there(tmp_path: Path) -> None:
    figures = drive(tmp_path, "lti", "--scenario", "straight")
    for key in ("ey_rms_m", "ey_peak_m", "epsi_rms_rad", "vx_rms_mps", "ticks"):
        assert isinstance(figures[key], int | float)
    for key in ("deadline_misses", "skipped_ticks", "final_mode", "scheduler", "model"):
        assert key in figures
    for key in ("step_us", "wake_us", "qp_us", "qp_iterations"):
        assert set(figures[key]) == {"p50", "p99", "p999", "max", "mean"}


def test_in_real_time_the_car_runs_beside_the_controller(tmp_path: Path) -> None:
    # A shared machine may stall longer than a vehicle's: lateness is not what is tested here.
    generous = ("--realtime.deadline-ms", "25", "--scenario", "straight")
    figures = drive(tmp_path, "mdk-net-paper", *generous, pace="realtime")
    assert figures["final_mode"] == "STANDBY"
    assert figures["ticks"] + figures["skipped_ticks"] >= 200
    assert figures["ey_peak_m"] <= 0.3
    assert figures["wake_us"]["max"] > 0.0
