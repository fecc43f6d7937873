"""`rt-controller` refuses what does not fit, with a message that names it and an exit code."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_models import WITH_PAST, make_bundle

from rt_controller import cli
from rt_controller.contract.artifact import (
    Lift,
    find_model,
    load_bundle,
    save_bundle,
    shipped_model,
)
from rt_controller.contract.schema import VEHICLE
from rt_controller.realtime.clock import LockstepClock
from rt_controller.terminal import run as terminal_run

Run = Callable[..., tuple[int, str]]
ON_SOCKETCAN = ("--bus", "socketcan", "--channel", "can0")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Call the program in this process; its exit code and what it wrote on stderr."""

    def call(*arguments: str | Path) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["rt-controller", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0), capsys.readouterr().err

    return call


def test_a_folder_without_a_bundle_is_refused(run: Run, tmp_path: Path) -> None:
    code, message = run(*ON_SOCKETCAN, "--model", tmp_path)
    assert code == 2
    assert "koopman.npz" in message


def test_a_shipped_model_is_found_by_its_name() -> None:
    assert find_model("lti") == shipped_model("lti")
    assert find_model(None) == shipped_model("mdk-net")


def test_a_misspelt_model_is_refused_with_the_shipped_ones(run: Run) -> None:
    code, message = run(*ON_SOCKETCAN, "--model", "mdknet")
    assert code == 2
    assert "expected one of lti, mdk-net, mdk-net-paper" in message
    assert "Did you mean mdk-net?" in message


def test_a_path_is_never_taken_for_a_shipped_name() -> None:
    assert find_model("./lti") == Path("lti")
    assert find_model(Path("runs/lti")) == Path("runs/lti")


def test_an_encoder_of_another_export_is_refused(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "mixed"
    shutil.copytree(shipped_model("mdk-net-paper"), folder)
    shutil.copy(shipped_model("lti") / "encoder.onnx", folder / "encoder.onnx")
    code, message = run(*ON_SOCKETCAN, "--model", folder)
    assert code == 2
    assert "SHA-256" in message


def test_a_bundle_of_another_format_is_refused(run: Run, tmp_path: Path) -> None:
    save_bundle(tmp_path, load_bundle(shipped_model("lti")), "card")
    with np.load(tmp_path / "koopman.npz") as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "koopman.npz", **{**arrays, "format_version": np.int64(1)})
    code, message = run(*ON_SOCKETCAN, "--model", tmp_path)
    assert code == 2
    assert "expected format_version = 2, found 1" in message
    assert "run offline-export" in message


def test_a_model_with_another_period_is_refused(run: Run, tmp_path: Path) -> None:
    slower = replace(make_bundle(Lift()), schema=replace(VEHICLE, dt_s=2.0 * VEHICLE.dt_s))
    save_bundle(tmp_path, slower, "card")
    code, message = run(*ON_SOCKETCAN, "--model", tmp_path)
    assert code == 2
    assert f"expected period in s = {VEHICLE.dt_s:g}, found {2.0 * VEHICLE.dt_s:g}" in message


def test_a_latent_weight_is_refused_for_an_encoder_with_history(run: Run, tmp_path: Path) -> None:
    save_bundle(tmp_path, make_bundle(WITH_PAST), "card")
    code, message = run(*ON_SOCKETCAN, "--model", tmp_path, "--mpc.latent-weight", "0.001")
    assert code == 2
    assert "latent-weight 0" in message


def test_an_unknown_interface_is_refused_with_the_known_ones(run: Run) -> None:
    code, message = run("--bus", "sockketcan")
    assert code == 5
    assert "socketcan" in message


def test_a_missing_network_interface_is_named(run: Run) -> None:
    code, message = run("--bus", "socketcan", "--channel", "vcan77")
    assert code == 5
    assert "vcan77" in message


@pytest.mark.parametrize("option", [("--pace", "lockstep"), ("--scenario", "straight")])
def test_options_of_the_simulated_car_need_the_virtual_bus(
    run: Run, option: tuple[str, str]
) -> None:
    code, message = run("--bus", "socketcan", *option)
    assert code == 2
    assert option[0] in message


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        (("--mpc.horizon", "2"), "--mpc.horizon: expected at least 3, found '2'"),
        (("--mpc.tolerance.ey-m", "-0.1"), "--mpc.tolerance.ey-m: expected more than 0.0"),
        (("--realtime.priority", "100"), "--realtime.priority: expected at most 99"),
        (("--realtime.cpu", "99999999999999999999999"), "--realtime.cpu"),
        (("--pace", "leisurely"), "--pace"),
        (("--duration-s", "0"), "--duration-s: expected more than 0.0"),
        (("--duration-s", "inf"), "--duration-s: expected a finite number"),
        (("--wait-s", "nan"), "--wait-s: expected a finite number"),
        (("--no-such-option", "1"), "--no-such-option"),
    ],
)
def test_a_value_outside_its_range_is_refused(
    run: Run, option: tuple[str, str], expected: str
) -> None:
    code, message = run("--bus", "virtual", *option)
    assert code == 2
    assert expected in message


def test_all_refused_options_are_named_at_once(run: Run) -> None:
    code, message = run(
        *("--bus", "virtual", "--mpc.horizon", "1"),
        *("--mpc.tolerance.ey-m", "-1", "--realtime.phase-ms", "99"),
    )
    assert code == 2
    for name in ("--mpc.horizon", "--mpc.tolerance.ey-m", "--realtime.phase-ms"):
        assert name in message


def test_the_command_line_overrides_a_settings_file(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "controller.toml"
    file.write_text('bus = "sockketcan"\n[mpc]\nhorizon = 10\n')
    code, message = run("--config", file)
    assert code == 5
    assert "sockketcan" in message
    code, message = run("--config", file, "--bus", "nosuchbus")
    assert code == 5
    assert "nosuchbus" in message


def test_all_mistakes_of_a_settings_file_are_named_at_once(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "controller.toml"
    file.write_text("[mpc]\nhorizont = 10\n[mpc.tolerance]\ney_m = -3\n[realtime]\nphase_ms = 99\n")
    code, message = run("--config", file, "--bus", "socketcan")
    assert code == 2
    assert "mpc.horizont: no such setting" in message
    assert "Did you mean horizon?" in message
    assert "mpc.tolerance.ey_m: expected more than 0.0, found -3" in message
    assert "realtime.phase_ms" in message


@pytest.mark.parametrize("content", [b"\xe4 = 1\n", b"mpc = [\n"])
def test_a_settings_file_that_is_not_toml_is_refused(
    run: Run, tmp_path: Path, content: bytes
) -> None:
    file = tmp_path / "controller.toml"
    file.write_bytes(content)
    code, message = run("--config", file, "--bus", "virtual")
    assert code == 2
    assert "expected a TOML file in UTF-8" in message


def test_a_missing_settings_file_is_named(run: Run, tmp_path: Path) -> None:
    code, message = run("--config", tmp_path / "nope.toml", "--bus", "virtual")
    assert code == 2
    assert "nope.toml" in message


@pytest.mark.parametrize("option", ["--json", "--ticks"])
def test_an_output_file_without_a_folder_is_refused_before_the_drive(
    run: Run, tmp_path: Path, option: str
) -> None:
    code, message = run("--bus", "virtual", option, tmp_path / "missing" / "file")
    assert code == 2
    assert option in message


class NoCar:
    """A virtual car that is never asked to drive."""

    def clock(self, pace: object) -> LockstepClock:
        return LockstepClock(round(VEHICLE.dt_s * 1e9), lambda now_ns: None)

    def close(self) -> None:
        pass


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".MF4"])
def test_a_log_in_another_format_is_refused_with_the_command_that_converts(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, suffix: str
) -> None:
    log = tmp_path / f"drive{suffix}"
    monkeypatch.setattr(terminal_run, "build_virtual_car", lambda *_: NoCar())
    code, message = run("--bus", "virtual", "--pace", "lockstep", "--record", log)
    assert code == 2
    assert "logconvert" in message
    assert not log.exists()


def test_a_message_is_neither_wrapped_nor_read_as_markup(run: Run) -> None:
    path = "/tmp/[/x]/[sim]/" + 20 * "long-folder/"
    code, message = run("--bus", "virtual", "--model", path)
    assert code == 2
    assert path in message


@pytest.mark.parametrize("module", ["rt_controller.cli", "sim_bridge.cli"])
def test_help_and_version_import_neither_python_can_nor_numpy(module: str) -> None:
    program = (
        f"import sys; from {module} import main; sys.argv = ['program', '--help']\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'can', 'numpy', 'scipy', 'onnxruntime', 'numba'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert "Exit codes" in found.stdout


def test_python_can_is_imported_without_asammdf() -> None:
    program = "import sys, rt_controller.bus.transport; sys.exit('asammdf' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
