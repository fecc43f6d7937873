"""A recorded drive is replayed to the bit; every other command is listed."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest
from virtual_drive import SHORT_LANE_CHANGE, drive

from rt_controller.cli import app
from rt_controller.contract.errors import ConfigError
from rt_controller.recording.journal import journal_path


def replay(log: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit code and the content of `--json`."""
    file = log.with_suffix(".json")
    code = app.meta(
        ["replay", str(log), "--json", str(file), "--quiet", *options],
        result_action="return_value",
    )
    figures: dict[str, Any] = json.loads(file.read_text())
    return int(str(code)), figures


def copy_of(recorded_log: Path, folder: Path) -> Path:
    log = folder / recorded_log.name
    shutil.copy(recorded_log, log)
    shutil.copy(journal_path(recorded_log), journal_path(log))
    return log


def test_an_unchanged_program_commands_the_same_bits(recorded_log: Path) -> None:
    code, figures = replay(recorded_log)
    assert (code, figures["is_identical"], figures["differences"]) == (0, True, [])
    assert figures["ticks"] > 70


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_a_converted_log_is_replayed_and_explained(
    recorded_log: Path, tmp_path: Path, suffix: str
) -> None:
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


def test_a_drive_in_real_time_is_replayed_to_the_bit_too(tmp_path: Path) -> None:
    """What a tick had read, and which preparation there was time for, depends on the machine."""
    log = tmp_path / "run.log"
    options = ("--duration-s", "1", "--max-misses", "100000", "--record", str(log))
    drive(tmp_path, "mdk-net", "--scenario", SHORT_LANE_CHANGE, *options, pace="realtime")
    code, figures = replay(log)
    assert (code, figures["differences"]) == (0, [])


def test_a_changed_command_is_listed_with_its_tick_and_both_values(
    recorded_log: Path, tmp_path: Path
) -> None:
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


def test_a_lost_state_frame_changes_the_commands_from_its_tick_on(
    recorded_log: Path, tmp_path: Path
) -> None:
    log = copy_of(recorded_log, tmp_path)
    lines = log.read_text().splitlines(keepends=True)
    number = [i for i, line in enumerate(lines) if " 110#" in line][40]
    lines[number] = lines[number].rstrip()[:-2] + "EE\n"  # its checksum is wrong now
    log.write_text("".join(lines))
    code, figures = replay(log)
    assert code == 8
    first = figures["differences"][0]["tick"]
    assert {each["signal"] for each in figures["differences"] if each["tick"] == first} >= {
        "mode",
        "cause",
    }


def test_another_model_commands_other_inputs(recorded_log: Path) -> None:
    code, figures = replay(recorded_log, "--model", "mdk-net-paper")
    assert code == 8
    assert figures["differences_by_signal"]["steer_rad"] > 10


def test_error_frames_of_any_class_do_not_shift_the_frames_of_a_candump_log(
    recorded_log: Path, tmp_path: Path
) -> None:
    log = copy_of(recorded_log, tmp_path)
    lines = log.read_text().splitlines(keepends=True)
    for error_class in (0x004, 0x040, 0x080, 0x100):
        lines.insert(100, f"(1.000000) can0 {0x2000_0000 | error_class:08X}#0000000000000000\n")
    log.write_text("".join(lines))
    code, figures = replay(log)
    assert (code, figures["is_identical"]) == (0, True)


def test_frames_that_were_dropped_make_a_replay_incomplete(
    recorded_log: Path, tmp_path: Path
) -> None:
    log = copy_of(recorded_log, tmp_path)
    header, *ticks = journal_path(log).read_text().splitlines(keepends=True)
    ticks[50] = ticks[50].replace('"dropped":0', '"dropped":3')
    journal_path(log).write_text("".join([header, *ticks]))
    code, figures = replay(log)
    assert (code, figures["incomplete_from_tick"], figures["is_identical"]) == (8, 50, False)


def damaged(lines: list[str]) -> list[str]:
    return [*lines[:200], lines[200].replace("#", "#Z"), *lines[201:]]


@pytest.mark.parametrize(
    ("name", "edit", "expected"),
    [
        ("run.log", lambda lines: lines[:300], "found fewer: one of the two was cut off"),
        ("run.log", lambda _: ["not a frame\n"], r"line 1: expected \(seconds\) .*Copy it again"),
        ("run.log", damaged, r"line 201: expected \(seconds\) .*, found '.*#Z"),
        (
            "run.blf",
            lambda _: ["LOGG damaged"],
            "in the format of its suffix, found a file",
        ),
        ("run.log.journal", lambda _: None, r"expected its journal run\.log\.journal .* keep them"),
        (
            "run.log.journal",
            lambda lines: [re.sub('sha256":".{64}', f'sha256":"{64 * "0"}', lines[0]), *lines[1:]],
            r"expected the recorded one, 00000000, found .*--model",
        ),
    ],
)
def test_files_that_cannot_be_replayed_are_refused_with_the_remedy(
    recorded_log: Path,
    tmp_path: Path,
    name: str,
    edit: Callable[[list[str]], list[str] | None],
    expected: str,
) -> None:
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
    with pytest.raises(ConfigError, match=expected):
        replay(log)
