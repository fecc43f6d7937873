"""The help of a command, and what is not imported for it."""

import inspect
import subprocess
import sys
from typing import Any

import docstring_parser
import pytest
from pydantic import BaseModel

from rt_controller import cli
from rt_controller.config import MpcSettings


@pytest.mark.parametrize("module", ["rt_controller.cli", "sim_bridge.cli"])
def test_help_and_version_import_neither_python_can_nor_numpy(module: str) -> None:
    program = (
        f"import sys; from {module} import main; sys.argv = ['program', '--help']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'can', 'numpy', 'scipy', 'onnxruntime'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert "Exit codes" in found.stdout


def test_help_has_a_usage_line_without_commands_and_reads_only_this_projects_source(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read: list[object] = []
    getsource = inspect.getsource

    def record(found: Any) -> str:
        read.append(found)
        return getsource(found)

    monkeypatch.setattr(inspect, "getsource", record)
    monkeypatch.setattr("sys.argv", ["rt-controller", "--help"])
    parse = docstring_parser.parse_from_object
    with pytest.raises(SystemExit):
        cli.main()
    assert docstring_parser.parse_from_object is parse
    shown = capsys.readouterr().out
    assert shown.startswith("Usage: rt-controller --bus NAME [OPTIONS]\n")
    assert "double_lane_change," in shown
    assert "lateral error" in shown
    assert MpcSettings in read
    assert BaseModel not in read


def test_python_can_is_imported_without_asammdf() -> None:
    program = "import sys, rt_controller.bus.transport; sys.exit('asammdf' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
