"""A journal that is no longer the one that was written is refused by what is wrong in it."""

import json
from pathlib import Path
from typing import Any

import pytest

from rt_controller.contract.errors import ConfigError
from rt_controller.recording.journal import Header, journal_path, read_journal

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


@pytest.mark.parametrize(
    ("line", "changed", "expected"),
    [
        (1, {"journal_format": 2}, "journal_format: expected 1, found 2"),
        (1, {"model": "lti"}, "model: expected a table, found 'lti'"),
        (1, {"max_iterations": -1}, "max_iterations: expected more than 0, found -1"),
        (1, {"version": None}, "version: expected a text, found None"),
        (2, {"began_ns": "early"}, "began_ns: expected an integer, found 'early'"),
        (2, {"skipped": -4}, "skipped: expected at least 0, found -4"),
        (2, {"control": ["a", "b", "c"]}, r"control\[0\]: expected a number, found 'a'"),
        (2, {"mode": "FAST"}, "mode: expected one of STANDBY, "),
        (2, {"calls": [["jump"]]}, r"calls\[0\]\[0\]: expected 'received', "),
        (2, {"calls": [["received", 1, -3]]}, r"calls\[0\]\[2\]: expected at least 0"),
        (3, '{"tick":1,"cal', "found another text"),
        (3, "[1, 2]", "found another text"),
        (3, '{"calls": []}', "tick: expected a value, found none"),
    ],
)
def test_a_line_that_was_edited_or_damaged_is_refused_with_its_number_and_field(
    tmp_path, line, changed, expected
):
    header, tick = HEADER, TICK
    if isinstance(changed, dict):
        header, tick = (
            {**each, **changed} if n == line else each for n, each in ((1, header), (2, tick))
        )
    log = log_with_journal(tmp_path, header, tick)
    if isinstance(changed, str):
        with journal_path(log).open("a") as file:
            file.write(f"{changed}\n")
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
