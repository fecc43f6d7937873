"""`--config FILE`: options of the command line come first, and every mistake is named."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

Run = Callable[..., tuple[int, str]]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b'bus = "sockketcan"', "--bus 'nosuchbus'"),  # the command line comes first
        (
            b"[mpc]\nhorizont = 10\n[mpc.tolerance]\ney_m = -3\n[realtime]\nphase_ms = 99\n",
            r"mpc.tolerance.ey_m: expected at least 1e-06, found -3.\n"
            r"mpc.horizont: no such setting \(did you mean horizon\?\).\nrealtime.phase_ms: ",
        ),
        (b"\xe4 = 1\n", "expected a TOML file in UTF-8"),
        (b"mpc = [\n", "expected a TOML file in UTF-8"),
        (b"a = " + b"[" * 20_000, "expected a TOML file in UTF-8"),
        (None, "expected a TOML file, found Not a regular file"),
    ],
)
def test_every_mistake_of_a_settings_file_is_named(
    run: Run, tmp_path: Path, content: bytes | None, expected: str
) -> None:
    file = tmp_path / "controller.toml"
    if content is None:
        os.mkfifo(file)
    else:
        file.write_bytes(content)
    code, message = run("--config", file, "--bus", "nosuchbus")
    assert code == 2
    assert re.search(expected, message)
