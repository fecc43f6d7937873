"""A journal that is no longer the one that was written is refused by what is wrong in it."""

import json
from pathlib import Path
from typing import Any

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.recording.header import changed_versions, recorded_config
from rt_controller.recording.journal import journal_path, read_journal

HEADER: dict[str, Any] = {
    "journal_format": 1,
    "version": "0.1.0",
    "model": {"name": "lti", "sha256": "0" * 64},
    "config": {},
    "max_iterations": None,
    "catalogue": "00000000",
    "is_fd": False,
    "packages": {},
    "machine": "Linux x86_64",
}
TICK: dict[str, Any] = {
    "tick": 0,
    "began_ns": 25_000_000,
    "scheduled_ns": 25_000_000,
    "skipped": 0,
    "missed_last": False,
    "mode": "STANDBY",
    "cause": "NONE",
    "control": [0.0, 0.0, 0.0],
    "faults": 0,
    "dropped": 0,
    "sent_after_us": 0.0,
    "late_cause": None,
    "times": {"step_us": 1.0},
    "calls": [["warm_up"], ["received", 25_000_000, 9]],
}


def log_with_journal(folder: Path, header: dict[str, Any], *ticks: dict[str, Any]) -> Path:
    log = folder / "run.log"
    journal_path(log).write_text("".join(json.dumps(line) + "\n" for line in (header, *ticks)))
    return log


def test_a_line_has_the_calls_and_the_command_of_its_tick(tmp_path: Path) -> None:
    last = {"tick": -1, "calls": [["send_safe_command"]]}
    _, (tick, after) = read_journal(log_with_journal(tmp_path, HEADER, TICK, last))
    assert [call.name for call in tick.calls] == ["warm_up", "received"]
    assert (tick.number, tick.calls[1].frames, tick.mode.name) == (0, 9, "STANDBY")
    assert (after.number, after.calls[0].name) == (-1, "send_safe_command")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("config", []),
        ("model", "lti"),
        ("packages", [1]),
        ("max_iterations", "many"),
        ("max_iterations", -1),
        ("is_fd", "both"),
    ],
)
def test_a_header_with_a_field_of_another_type_is_refused_by_its_name(
    tmp_path: Path, field: str, value: object
) -> None:
    with pytest.raises(ConfigError, match=rf"{field}: expected .*, found .*\nCopy it again"):
        read_journal(log_with_journal(tmp_path, {**HEADER, field: value}))


@pytest.mark.parametrize("field", ["version", "config", "model", "packages", "max_iterations"])
def test_a_header_without_a_field_is_refused_by_its_name(tmp_path: Path, field: str) -> None:
    header = {name: value for name, value in HEADER.items() if name != field}
    with pytest.raises(ConfigError, match=rf"{field}: expected a value, found none"):
        read_journal(log_with_journal(tmp_path, header))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("began_ns", "early"),
        ("began_ns", None),
        ("skipped", -4),
        ("control", ["a", "b", "c"]),
        ("times", [1]),
        ("sent_after_us", "x"),
        ("mode", "FAST"),
        ("calls", [["jump"]]),
        ("calls", [["received", 1, -3]]),
        ("calls", [["received", 1, "x"]]),
        ("calls", ["warm_up"]),
    ],
)
def test_a_tick_with_another_content_is_refused(tmp_path: Path, field: str, value: object) -> None:
    with pytest.raises(ConfigError, match=r"expected the journal of a log, .*found"):
        read_journal(log_with_journal(tmp_path, HEADER, {**TICK, field: value}))


def test_settings_of_another_version_are_named_with_the_version_that_has_them() -> None:
    with pytest.raises(ConfigError, match=r"turbo: no such setting.* recorded it \(0\.1\.0\)"):
        recorded_config({**HEADER, "config": {"turbo": 1}})


def test_a_drive_on_a_core_that_this_machine_lacks_can_be_replayed() -> None:
    config = recorded_config({**HEADER, "config": {"realtime": {"cpu": 4096, "phase_ms": 3.0}}})
    assert (config.realtime.cpu, config.realtime.phase_ms) == (None, 3.0)


def test_other_messages_and_another_machine_are_named() -> None:
    messages, machine = changed_versions({**HEADER, "machine": "Linux other"})
    assert messages.startswith("messages 00000000 then, ")
    assert machine.startswith("machine Linux other then, ")


@pytest.mark.parametrize(
    ("last_line", "found"),
    [
        ('{"tick":1,"cal', "another text"),
        ("[1, 2]", "another text"),
        ("", "an empty line"),
        ('{"calls": []}', "no field 'tick'"),
        ('{"tick": 1, "calls": []}', "no field 'began_ns'"),
    ],
)
def test_a_line_that_is_no_tick_is_refused_with_its_number_and_what_it_is(
    tmp_path: Path, last_line: str, found: str
) -> None:
    log = log_with_journal(tmp_path, HEADER, TICK)
    with journal_path(log).open("a") as file:
        file.write(f"{last_line}\n")
    with pytest.raises(ConfigError, match=rf"\.journal, line 3: .* found {found}\. Copy it again"):
        read_journal(log)


def test_a_tick_of_an_unknown_mode_is_refused_with_the_modes(tmp_path: Path) -> None:
    log = log_with_journal(tmp_path, HEADER, {**TICK, "mode": "FAST"})
    with pytest.raises(ConfigError, match=r"line 2: .*\n.*mode: expected one of STANDBY, "):
        read_journal(log)
