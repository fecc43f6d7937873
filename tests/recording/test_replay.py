"""A recorded drive is replayed to the bit, and explained; every other command is listed."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import can
import pytest
from virtual_drive import SHORT_LANE_CHANGE, drive

from rt_controller.cli import app
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.recording.journal import Header, journal_path, read_journal


@pytest.fixture(scope="session")
def recorded_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log of two seconds in lockstep, with its journal beside it."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "run.log"
    drive(folder, "lti", "--scenario", SHORT_LANE_CHANGE, "--record", str(log))
    return log


def replay(log: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit code and the content of `--json`."""
    file = log.with_suffix(".json")
    code = app.meta(
        ["replay", str(log), "--json", str(file), "--quiet", *options], result_action="return_value"
    )
    figures: dict[str, Any] = json.loads(file.read_text())
    return int(str(code)), figures


def copy_of(recorded_log: Path, folder: Path) -> Path:
    log = folder / recorded_log.name
    shutil.copy(recorded_log, log)
    shutil.copy(journal_path(recorded_log), journal_path(log))
    return log


def test_an_unchanged_program_commands_the_same_bits(recorded_log):
    code, figures = replay(recorded_log)
    assert (code, figures["is_identical"], figures["differences"]) == (0, True, [])
    assert figures["ticks"] > 70


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_a_converted_log_is_replayed_and_explained(recorded_log, tmp_path, suffix):
    log = tmp_path / f"run{suffix}"
    shutil.copy(journal_path(recorded_log), journal_path(log))
    with can.LogReader(recorded_log) as reader, can.Logger(log) as writer:
        for frame in reader:
            writer(frame)
    code, figures = replay(log)
    assert (code, figures["differences"]) == (0, [])
    assert figures["ticks"] > 70
    arguments = ["explain", str(log), "--tick", "30", "--quiet"]
    assert app.meta(arguments, result_action="return_value") == 0


def test_a_drive_in_real_time_is_replayed_to_the_bit_too(tmp_path):
    """What a tick had read, and which preparation there was time for, depends on the machine."""
    log = tmp_path / "run.log"
    options = ("--max-misses", "100000", "--record", str(log))
    drive(tmp_path, "mdk-net", "--scenario", SHORT_LANE_CHANGE, *options, pace="realtime")
    code, figures = replay(log)
    assert (code, figures["differences"]) == (0, [])


def test_a_changed_command_is_listed_with_its_tick_and_both_values(recorded_log, tmp_path):
    log = copy_of(recorded_log, tmp_path)
    lines = log.read_text().splitlines(keepends=True)
    number = [i for i, line in enumerate(lines) if " 100#" in line][20]
    lines[number] = lines[number].rstrip()[:-2] + "EE\n"
    log.write_text("".join(lines))
    code, figures = replay(log)
    assert code == 8
    (difference,) = figures["differences"]
    assert (difference["tick"], difference["signal"]) == (20, "ACT_CMD")
    assert difference["recorded"].endswith("EE")
    assert difference["replayed"] != difference["recorded"]


def test_another_model_commands_other_inputs(recorded_log):
    code, figures = replay(recorded_log, "--model", "mdk-net-paper")
    assert code == 8
    assert figures["differences_by_signal"]["steer_rad"] > 10


def test_error_frames_of_any_class_do_not_shift_the_frames_of_a_candump_log(recorded_log, tmp_path):
    log = copy_of(recorded_log, tmp_path)
    lines = log.read_text().splitlines(keepends=True)
    for error_class in (0x004, 0x040, 0x080, 0x100):
        lines.insert(100, f"(1.000000) can0 {0x2000_0000 | error_class:08X}#0000000000000000\n")
    log.write_text("".join(lines))
    code, figures = replay(log)
    assert (code, figures["is_identical"]) == (0, True)


def test_frames_that_were_dropped_make_a_replay_incomplete(recorded_log, tmp_path):
    log = copy_of(recorded_log, tmp_path)
    header, *ticks = journal_path(log).read_text().splitlines(keepends=True)
    ticks[50] = ticks[50].replace('"dropped":0', '"dropped":3')
    journal_path(log).write_text("".join([header, *ticks]))
    code, figures = replay(log)
    assert (code, figures["incomplete_from_tick"], figures["is_identical"]) == (8, 50, False)


@pytest.mark.parametrize(
    ("name", "edit", "expected"),
    [
        ("run.log", lambda lines: lines[:300], "found fewer: one of the two was cut off"),
        ("run.log", lambda _: ["not a frame\n"], r"line 1: expected \(seconds\) .*Copy it again"),
        ("run.log", lambda _: ["\0\1\n"], "found binary data"),
        ("run.log", lambda _: [], "found an empty file"),
        ("run.blf", lambda _: ["LOGG damaged"], "in the format of its suffix, found a file"),
        ("run.log.journal", lambda _: None, r"expected its journal run\.log\.journal .* keep them"),
        (
            "run.log.journal",
            lambda lines: [
                re.sub('"sha256":".{64}', f'"sha256":"{64 * "0"}', lines[0]),
                *lines[1:],
            ],
            r"expected the recorded one, 00000000, found .*--model",
        ),
    ],
)
def test_files_that_cannot_be_replayed_are_refused_with_the_remedy(
    recorded_log, tmp_path, name, edit, expected
):
    log, file = copy_of(recorded_log, tmp_path), tmp_path / name
    if name.endswith(".blf"):
        log = file
        shutil.copy(journal_path(recorded_log), journal_path(log))
        file.touch()
    edited = edit(file.read_text().splitlines(keepends=True))
    if edited is None:
        file.unlink()
    else:
        file.write_text("".join(edited))
    with pytest.raises((ConfigError, DatasetError), match=expected):
        replay(log)


def explain(log: Path, tick: int | None, folder: Path) -> dict[str, Any]:
    file = folder / "tick.json"
    chosen = [] if tick is None else ["--tick", str(tick)]
    arguments = ["explain", str(log), *chosen, "--json", str(file), "--quiet"]
    assert app.meta(arguments, result_action="return_value") == 0
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def test_a_tick_is_explained_on_one_page(recorded_log, tmp_path, capsys):
    found = explain(recorded_log, 30, tmp_path)
    assert found["state"]["vx_mps"] > 10.0
    assert found["path"]["v_mps"] > 10.0
    assert set(found["control"]) == {"throttle", "brake_n", "steer_rad"}
    margins = {each["check"]: each["margin"] for each in found["checks"]}
    unchecked = {name for name, margin in margins.items() if margin is None}
    engagement = {"engagement, lateral", "engagement, heading"}
    assert unchecked == {"speed by pedals", "training", *engagement}
    assert {"age of the state, with its transport", "change of steer_rad in this period"} < set(
        margins
    )
    assert all(margin is None or margin >= 0.0 for margin in margins.values())
    assert (found["is_identical"], found["reasons"]) == (True, [])
    assert found["command_from"] == "plan of this tick"
    assert found["stage_times"]["plan_us"] > 0.0
    printed = capsys.readouterr().out
    assert printed.startswith("Tick 30 drove, and nothing was wrong: plan of this tick.\n")
    for title in ("state", "path", "control", "checks", "tracking", "times of the stages"):
        assert title in printed
    code, same = replay(recorded_log, "--tick", "30")
    assert (code, same, capsys.readouterr().out) == (0, found, printed)


def test_a_degraded_tick_says_what_was_missing(recorded_log, tmp_path):
    log = copy_of(recorded_log, tmp_path)
    lines = log.read_text().splitlines(keepends=True)
    number = [i for i, line in enumerate(lines) if " 110#" in line][40]
    lines[number] = lines[number].rstrip()[:-2] + "EE\n"  # its checksum is wrong now
    log.write_text("".join(lines))
    code, figures = replay(log)
    first = figures["differences"][0]["tick"]
    changed = {each["signal"] for each in figures["differences"] if each["tick"] == first}
    assert (code, changed >= {"mode", "cause"}) == (8, True)
    ticks = [explain(log, tick, tmp_path) for tick in (first, first + 1)]
    degraded = [tick for tick in ticks if tick["mode"] == "HOLD_PLAN"]
    assert len(degraded) == 1
    assert degraded[0]["state"] is None
    assert degraded[0]["cause"] == "STATE_LOST"
    assert degraded[0]["remedy"].startswith("Check that the vehicle")
    assert not degraded[0]["is_identical"]
    before = first - 1
    assert degraded[0]["command_from"] == f"next inputs of the last plan (tick {before})"
    values = {check["check"]: check["value"] for check in degraded[0]["checks"]}
    assert values["heading"] is None  # without a state there is nothing to compare
    assert values["path acceleration"] is not None


def test_a_tick_that_the_drive_has_not_is_refused_with_those_that_it_has(recorded_log, tmp_path):
    with pytest.raises(ConfigError, match=r"--tick 9999: expected a tick of .*, found 0 to \d+"):
        explain(recorded_log, 9999, tmp_path)
    with pytest.raises(ConfigError, match=r"found none\. Choose one of the ticks 0 to"):
        explain(recorded_log, None, tmp_path)
    with pytest.raises(ConfigError, match=r"--tick: expected no --mcap"):
        replay(recorded_log, "--tick", "3", "--mcap", str(tmp_path / "tick.mcap"))


def test_without_a_tick_the_begin_of_the_safe_stop_is_explained(tmp_path, capsys):
    log = tmp_path / "stopped.log"
    options = ("--scenario", SHORT_LANE_CHANGE, "--duration-s", "0.5", "--record", str(log))
    summary = drive(tmp_path, "lti", *options)
    assert (summary["stop_tick"], summary["stop_s"]) == (20, 0.5)
    assert summary["stop_checks"] == []  # it was requested
    assert "from 0.500 s on (tick 20)" in capsys.readouterr().out
    found = explain(log, None, tmp_path)
    assert found["tick"] == summary["stop_tick"]
    assert (found["mode"], found["cause"]) == ("SAFE_STOP", "STOP_REQUESTED")
    printed = capsys.readouterr().out
    assert printed.startswith("Tick 20 was part of a safe stop: stop requested.\n")
    assert found["command_from"].endswith("steering wheel of the plan of this tick")
    later = {each["check"]: each["value"] for each in explain(log, 40, tmp_path)["checks"]}
    assert later["tracking"] is None  # not judged in a stop
    assert later["progress"] is not None


HEADER: dict[str, Any] = {
    "journal_format": 1,
    "version": "0.1.0",
    "model": {"name": "lti", "sha256": "0" * 64},
    "config": {},
    "max_iterations": None,
    "catalogue": "00000000",
    "is_fd": False,  # of earlier versions; not read any more
    "packages": {},
    "machine": "Linux x86_64",
}
TICK: dict[str, Any] = {"tick": 0, "mode": "STANDBY", "calls": [["warm_up"], ["received", 25, 9]]}


@pytest.mark.parametrize(
    ("line", "changed", "expected"),
    [
        (1, {"journal_format": 2}, "journal_format"),
        (1, {"max_iterations": -1}, "max_iterations"),
        (2, {"skipped": -4}, "skipped"),
        (2, {"control": ["a", "b", "c"]}, r"control\[0\]"),
        (2, {"mode": "FAST"}, "mode: expected one of STANDBY, "),
        (2, {"calls": [["jump"]]}, r"calls\[0\]\[0\]"),
        (2, {"calls": [["received", 1, -3]]}, r"calls\[0\]\[2\]"),
        (3, '{"tick":1,"cal', "found another text"),
        (3, "[1, 2]", "found another text"),
        (3, '{"calls": []}', "tick"),
    ],
)
def test_a_line_that_was_edited_or_damaged_is_refused_with_its_number_and_field(
    tmp_path, line, changed, expected
):
    log, lines = tmp_path / "run.log", [json.dumps(HEADER), json.dumps(TICK), ""]
    if isinstance(changed, dict):
        changed = json.dumps({**(HEADER if line == 1 else TICK), **changed})
    lines[line - 1] = changed
    journal_path(log).write_text("\n".join(lines))
    with pytest.raises(
        ConfigError, match=rf"(?s)\.journal, line {line}: .*{expected}.*Copy it again"
    ):
        read_journal(log)


def test_settings_of_another_version_are_named_with_the_version_that_has_them():
    with pytest.raises(ConfigError, match=r"turbo: no such setting.* recorded it \(0\.1\.0\)"):
        Header(**{**HEADER, "config": {"turbo": 1}}).controller_config()


def test_a_drive_on_a_core_that_this_machine_lacks_can_be_replayed():
    header = {**HEADER, "config": {"realtime": {"cpu": 4096, "phase_ms": 3.0}}}
    config = Header(**header).controller_config()
    assert (config.realtime.cpu, config.realtime.phase_ms) == (None, 3.0)


def test_other_messages_and_another_machine_are_named():
    messages, machine = Header(**{**HEADER, "machine": "Linux other"}).changed_versions()
    assert messages.startswith("messages 00000000 then, ")
    assert machine.startswith("machine Linux other then, ")
