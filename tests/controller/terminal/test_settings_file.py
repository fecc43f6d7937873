"""`--config FILE`: options of the command line come first, and every mistake is named."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., tuple[int, str]]


def test_the_command_line_overrides_a_settings_file(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "controller.toml"
    file.write_text('bus = "sockketcan"\n[mpc]\nhorizon = 10\n')
    code, message = run("--config", file)
    assert code == 2
    assert "sockketcan" in message
    code, message = run("--config", file, "--bus", "nosuchbus")
    assert code == 2
    assert "nosuchbus" in message


def test_all_mistakes_of_a_settings_file_are_named_at_once(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "controller.toml"
    file.write_text("[mpc]\nhorizont = 10\n[mpc.tolerance]\ney_m = -3\n[realtime]\nphase_ms = 99\n")
    code, message = run("--config", file, "--bus", "socketcan")
    assert code == 2
    assert "mpc.horizont: no such setting" in message
    assert "did you mean horizon?" in message
    assert "mpc.tolerance.ey_m: expected at least 1e-06, found -3" in message
    assert "realtime.phase_ms" in message


@pytest.mark.parametrize(
    "content",
    [b"\xe4 = 1\n", b"mpc = [\n", b"max_misses = " + b"9" * 5000, b"a = " + b"[" * 20_000],
)
def test_a_settings_file_that_is_not_toml_is_refused(
    run: Run, tmp_path: Path, content: bytes
) -> None:
    file = tmp_path / "controller.toml"
    file.write_bytes(content)
    code, message = run("--config", file, "--bus", "virtual")
    assert code == 2
    assert "expected a TOML file in UTF-8" in message


def test_a_pipe_of_settings_is_refused_instead_of_waited_for(run: Run, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "controller.toml")
    code, message = run("--config", tmp_path / "controller.toml", "--bus", "virtual")
    assert code == 2
    assert "expected a TOML file, found Not a regular file" in message


def test_a_missing_settings_file_is_named(run: Run, tmp_path: Path) -> None:
    code, message = run("--config", tmp_path / "nope.toml", "--bus", "virtual")
    assert code == 2
    assert "nope.toml" in message
