"""The help of a command, and what is not imported for it."""

import pkgutil
import re
import subprocess
import sys

import pytest

import offline.cli
import rt_controller.cli
import sim_bridge.cli


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


@pytest.mark.parametrize(
    ("program", "arguments", "shown", "hidden"),
    [
        ("rt_controller.cli.main", "--help", "--scenario", "--mpc.horizon"),
        ("rt_controller.cli.main", "--help-all", "--mpc.tolerance.ey-m", "All options:"),
        ("rt_controller.cli.main", "replay --help", "--mcap", "All options:"),
        ("sim_bridge.cli.main", "--help", "--signals", "--friction-right"),
        ("sim_bridge.cli.main", "--help-all", "--friction-right", "All options:"),
        ("offline.cli.train_main", "--help", "--steps", "--bilinear-rank"),
        ("offline.cli.train_main", "--help-all", "--bilinear-rank", "All options:"),
        ("offline.cli.evaluate_main", "--help", "--noise", "All options:"),
    ],
)
def test_help_shows_the_main_options_and_help_all_every_one_in_groups(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    program: str,
    arguments: str,
    shown: str,
    hidden: str,
) -> None:
    monkeypatch.setattr("sys.argv", ["program", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        pkgutil.resolve_name(program)()
    text = capsys.readouterr().out
    assert ended.value.code == 0
    assert text.startswith("Usage: ")
    assert shown in text
    assert hidden not in text
    options = re.findall(r"^│ [* ]*--", text.partition("─ Commands ─")[2].partition("╰")[2], re.M)
    assert "--help-all" in arguments or len(options) <= 13


def test_every_option_named_in_a_group_is_an_option_of_its_command() -> None:
    for app in (rt_controller.cli.app, sim_bridge.cli.app, offline.cli.train_app):
        names = set(" ".join(app.help_formatter.groups.values()).split())
        options = {
            name.removeprefix("--")
            for part in (app, offline.cli.ablate_app, offline.cli.tune_app, app.meta)
            if part.default_command is not None
            for argument in part.assemble_argument_collection()
            for name in argument.names
        }
        assert names - options - {"VARIANTS", "SPACE"} == set()


def test_python_can_is_imported_without_asammdf() -> None:
    program = "import sys, rt_controller.bus.transport; sys.exit('asammdf' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
