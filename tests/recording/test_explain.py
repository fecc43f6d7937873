"""The explanation of a tick names what it received, computed and sent, and why it was degraded."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from virtual_drive import SHORT_LANE_CHANGE, drive

from rt_controller.cli import app
from rt_controller.contract.errors import ConfigError
from rt_controller.recording.journal import journal_path


def explain(log: Path, tick: int | None, folder: Path) -> dict[str, Any]:
    file = folder / "tick.json"
    chosen = [] if tick is None else ["--tick", str(tick)]
    arguments = ["explain", str(log), *chosen, "--json", str(file), "--quiet"]
    assert app.meta(arguments, result_action="return_value") == 0
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def test_a_tick_is_explained_from_its_frames_to_its_command(
    recorded_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = explain(recorded_log, 30, tmp_path)
    received = {each["name"]: each["signals"] for each in found["frames"] if not each["is_sent"]}
    assert received["STATE_A"]["VelocityX, m/s"] == pytest.approx(found["state"]["vx_mps"])
    sent = {each["name"]: each["signals"] for each in found["frames"] if each["is_sent"]}
    assert sent["ACT_CMD"]["Throttle"] == pytest.approx(found["control"]["throttle"], abs=2e-5)
    plan = found["plan"]
    assert plan["inputs"][0]["steer_rad"] == pytest.approx(found["control"]["steer_rad"])
    assert len(plan["predicted_states"]) == len(plan["inputs"]) + 1
    assert sum(each["share"] for each in plan["cost_shares"]) == pytest.approx(1.0)
    assert plan["second_solution"]["largest_difference"] < 1e-4
    margins = {each["check"]: each["margin"] for each in found["checks"]}
    unchecked = [name for name, margin in margins.items() if margin is None]
    assert unchecked == ["speed by pedals", "engagement, lateral", "engagement, heading"]
    assert all(margin is None or margin >= 0.0 for margin in margins.values())
    assert found["is_identical"]
    assert found["reasons"] == []
    assert found["command_from"] == "plan of this tick"
    assert found["stage_times"]["plan_us"] > 0.0
    printed = capsys.readouterr().out
    assert printed.startswith("Tick 30 drove, and nothing was wrong: plan of this tick.\n")
    assert "value of brake_n, both" in printed
    assert "change of steer_rad" in printed
    for title in ("frames", "plan: predicted", "active bounds", "cost", "checks", "times of"):
        assert title in printed


def test_a_degraded_tick_says_what_was_missing(recorded_log: Path, tmp_path: Path) -> None:
    log = tmp_path / recorded_log.name
    shutil.copy(journal_path(recorded_log), journal_path(log))
    lines = recorded_log.read_text().splitlines(keepends=True)
    number = [i for i, line in enumerate(lines) if " 110#" in line][40]
    lines[number] = lines[number].rstrip()[:-2] + "EE\n"  # its checksum is wrong now
    log.write_text("".join(lines))
    ticks = [explain(log, tick, tmp_path) for tick in range(37, 41)]
    degraded = [tick for tick in ticks if tick["mode"] == "HOLD_PLAN"]
    assert len(degraded) == 1
    assert degraded[0]["plan"] is None
    assert degraded[0]["state"] is None
    assert "HOLD_PLAN: no new vehicle state arrived in time" in degraded[0]["reasons"]
    assert not degraded[0]["is_identical"]
    before = next(tick["tick"] for tick in ticks if tick["mode"] == "HOLD_PLAN") - 1
    assert degraded[0]["command_from"] == f"next inputs of the last plan (tick {before})"
    values = {check["check"]: check["value"] for check in degraded[0]["checks"]}
    assert values["heading"] is None  # without a state there is nothing to compare
    assert values["path acceleration"] is not None


def test_a_tick_that_the_drive_has_not_is_refused_with_those_that_it_has(
    recorded_log: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"--tick 9999: expected a tick of .*, found 0 to \d+"):
        explain(recorded_log, 9999, tmp_path)


def test_without_a_tick_the_begin_of_the_safe_stop_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "stopped.log"
    options = ("--scenario", SHORT_LANE_CHANGE, "--duration-s", "0.5", "--record", str(log))
    summary = drive(tmp_path, "lti", *options)
    assert (summary["stop_tick"], summary["stop_s"]) == (20, 0.5)
    assert summary["stop_checks"] == []  # it was requested
    assert "from 0.500 s on (tick 20)" in capsys.readouterr().out
    found = explain(log, None, tmp_path)
    assert found["tick"] == summary["stop_tick"]
    assert found["reasons"][0] == "SAFE_STOP: stop requested"
    printed = capsys.readouterr().out
    assert printed.startswith("Tick 20 was part of a safe stop: stop requested.\n")
    assert "plan (only its steering wheel is used)" in printed
    later = {each["check"]: each["value"] for each in explain(log, 40, tmp_path)["checks"]}
    assert later["tracking"] is None  # not judged in a stop
    assert later["progress"] is not None


def test_a_drive_without_a_safe_stop_needs_the_number_of_a_tick(
    recorded_log: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"found none\. Choose one of the ticks 0 to"):
        explain(recorded_log, None, tmp_path)
