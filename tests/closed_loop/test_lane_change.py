"""The shipped models drive the paper's double lane change, over a virtual bus, in lockstep."""

from pathlib import Path

import pytest
from virtual_drive import SHORT_LANE_CHANGE, Figures, drive

from rt_controller.control.piqp_solver import MAX_ITERATIONS
from rt_controller.control.warm_start import MAX_ROUNDS


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Figures, Path]:
    """The double lane change of the shipped model: its figures and its log."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "drive.log"
    return drive(folder, "mdk-net", "--record", str(log)), log


def assert_on_path(figures: Figures) -> None:
    assert figures["ey_rms_m"] <= 0.10
    assert figures["ey_peak_m"] <= 0.30
    assert figures["vx_rms_mps"] <= 0.5
    assert figures["ticks"] >= 400
    assert figures["final_mode"] == "STANDBY"
    assert figures["qp_iterations"]["max"] <= MAX_ROUNDS + MAX_ITERATIONS
    assert figures["ticks_by_fault"] == {}


def test_the_shipped_network_stays_on_its_path(recorded: tuple[Figures, Path]) -> None:
    assert_on_path(recorded[0])


def test_the_summary_has_all_figures(recorded: tuple[Figures, Path]) -> None:
    figures = recorded[0]
    for key in ("ey_rms_m", "ey_peak_m", "epsi_rms_rad", "vx_rms_mps", "ticks"):
        assert isinstance(figures[key], int | float)
    for key in ("deadline_misses", "skipped_ticks", "final_mode", "scheduler", "model"):
        assert key in figures
    for key in ("step_us", "wake_us", "qp_us", "qp_iterations"):
        assert set(figures[key]) == {"p50", "p99", "p999", "max", "mean"}


def test_the_network_of_the_paper_stays_on_its_path(tmp_path: Path) -> None:
    assert_on_path(drive(tmp_path, "mdk-net-paper"))


def test_the_same_run_twice_gives_the_same_frames(
    tmp_path: Path, recorded: tuple[Figures, Path]
) -> None:
    log = tmp_path / "second.log"
    # The log has the name of the channel.
    drive(tmp_path, "mdk-net", "--record", str(log), channel=recorded[1].parent.name)
    assert log.stat().st_size > 100_000
    assert log.read_bytes() == recorded[1].read_bytes()


def test_far_from_the_middle_of_its_speeds_a_network_drives_better_than_a_linear_model(
    tmp_path: Path,
) -> None:
    """The effect of the steering depends on the speed; a linear model has one for all speeds."""
    network, linear = (
        drive(tmp_path, model, "--scenario", "lane_change_120") for model in ("mdk-net", "lti")
    )
    assert network["ey_rms_m"] <= 0.10
    assert network["ey_rms_m"] < linear["ey_rms_m"]


def test_in_real_time_the_car_runs_beside_the_controller(tmp_path: Path) -> None:
    scenario = tmp_path / "short.toml"
    scenario.write_text(
        'format = 2\nname = "short"\nduration_s = 1.5\n[reference]\nspeed_kmh = 60.0\n'
    )
    # Deadlines are not tested here: a shared machine may stall longer than a vehicle's.
    options = ("--max-misses", "1000", "--scenario", str(scenario))
    figures = drive(tmp_path, "mdk-net-paper", *options, pace="realtime")
    assert figures["final_mode"] == "STANDBY"
    assert figures["ticks"] + figures["skipped_ticks"] >= 60
    assert figures["ey_peak_m"] <= 0.3
    assert figures["wake_us"]["max"] > 0.0


def test_a_drive_over_can_fd_is_that_over_classic_can(tmp_path: Path) -> None:
    """Up to the one tick by which the first frames differ, the same contents: the same drive."""
    found = []
    for name, options in (("classic", ()), ("fd", ("--fd",))):
        folder = tmp_path / name
        folder.mkdir()
        log = str(folder / "drive.log")
        scenario = ("--scenario", SHORT_LANE_CHANGE, "--record", log)
        found.append(drive(folder, "lti", *scenario, *options))
    classic, fast = found
    for key in ("ticks", "ey_rms_m", "ey_peak_m", "vx_rms_mps", "ending", "ticks_by_fault"):
        assert fast[key] == classic[key], key
    assert "##0" in (tmp_path / "fd" / "drive.log").read_text()
