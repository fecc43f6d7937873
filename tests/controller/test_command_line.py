"""What a person gets to read, and the exit code, when something does not fit."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_models import WITH_PAST, make_bundle

from rt_controller import cli
from rt_controller.contract.artifact import Lift, load_bundle, save_bundle
from rt_controller.contract.schema import VEHICLE
from rt_controller.realtime.clock import LockstepClock
from rt_controller.session import shipped_model


def exit_code(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["rt-controller", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code or 0


def test_a_folder_without_a_bundle_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ("--bus", "socketcan", "--channel", "can0", "--model", str(tmp_path))
    assert exit_code(monkeypatch, *arguments) == 2
    assert "koopman.npz" in capsys.readouterr().err


def test_an_encoder_of_another_export_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = tmp_path / "mixed"
    shutil.copytree(shipped_model("mdk-net-paper"), folder)
    shutil.copy(shipped_model("lti") / "encoder.onnx", folder / "encoder.onnx")
    arguments = ("--bus", "socketcan", "--channel", "can0", "--model", str(folder))
    assert exit_code(monkeypatch, *arguments) == 2
    assert "SHA-256" in capsys.readouterr().err


def test_a_model_of_another_format_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    save_bundle(tmp_path, load_bundle(shipped_model("lti")), "card")
    with np.load(tmp_path / "koopman.npz") as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "koopman.npz", **{**arrays, "format_version": np.int64(1)})
    arguments = ("--bus", "socketcan", "--channel", "can0", "--model", str(tmp_path))
    assert exit_code(monkeypatch, *arguments) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert "expected format_version = 2, found 1" in message
    assert "run offline-export" in message


def test_a_model_of_other_signals_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    slower = replace(make_bundle(Lift()), schema=replace(VEHICLE, dt_s=0.05))
    save_bundle(tmp_path, slower, "card")
    arguments = ("--bus", "socketcan", "--channel", "can0", "--model", str(tmp_path))
    assert exit_code(monkeypatch, *arguments) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert "expected period in s = 0.025, found 0.05" in message


def test_weight_on_latents_that_see_the_past_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    save_bundle(tmp_path, make_bundle(WITH_PAST), "card")
    arguments = ("--bus", "socketcan", "--channel", "can0", "--model", str(tmp_path))
    assert exit_code(monkeypatch, *arguments, "--mpc.latent-weight", "0.001") == 2
    assert "latent-weight 0" in " ".join(capsys.readouterr().err.split())


def test_an_unknown_interface_is_refused_with_the_known_ones(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, "--bus", "sockketcan") == 5
    assert "socketcan" in capsys.readouterr().err


def test_a_bus_that_does_not_exist_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, "--bus", "socketcan", "--channel", "vcan77") == 5
    assert "vcan77" in capsys.readouterr().err


def test_lockstep_needs_the_car_in_this_process(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, "--bus", "socketcan", "--pace", "lockstep") == 2
    assert "lockstep" in capsys.readouterr().err


@pytest.mark.parametrize(
    "option",
    [
        ("--mpc.horizon", "1"),
        ("--mpc.tolerance.ey-m", "-0.1"),
        ("--realtime.priority", "100"),
        ("--pace", "leisurely"),
        ("--no-such-option", "1"),
    ],
)
def test_a_setting_that_makes_no_sense_is_a_usage_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], option: tuple[str, str]
) -> None:
    assert exit_code(monkeypatch, "--bus", "socketcan", *option) == 2
    captured = capsys.readouterr()
    name = option[0].lstrip("-").split(".")[-1]
    assert name in (captured.out + captured.err).replace("_", "-")


def test_a_settings_file_is_read_and_the_command_line_goes_over_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "controller.toml"
    file.write_text('bus = "sockketcan"\n[mpc]\nhorizon = 10\n')
    assert exit_code(monkeypatch, "--config", str(file)) == 5
    assert "sockketcan" in capsys.readouterr().err
    assert exit_code(monkeypatch, "--config", str(file), "--bus", "nosuchbus") == 5
    assert "nosuchbus" in capsys.readouterr().err


def test_a_settings_file_with_an_unknown_name_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "controller.toml"
    file.write_text("[mpc]\nhorizont = 10\n")
    assert exit_code(monkeypatch, "--config", str(file), "--bus", "socketcan") == 2


def test_a_summary_that_cannot_be_written_is_known_before_the_drive(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    nowhere = tmp_path / "missing" / "summary.json"
    assert exit_code(monkeypatch, "--bus", "virtual", "--json", str(nowhere)) == 2
    assert "summary.json" in capsys.readouterr().err.replace("\n", "")


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".MF4"])
def test_a_log_in_another_format_is_refused_with_the_way_to_it(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    suffix: str,
) -> None:
    log = tmp_path / f"drive{suffix}"
    arguments = ("--bus", "virtual", "--pace", "lockstep", "--record", str(log))
    monkeypatch.setattr(cli, "build_virtual_car", lambda *_: NoCar())
    assert exit_code(monkeypatch, *arguments) == 2
    assert "logconvert" in capsys.readouterr().err
    assert not log.exists()


class NoCar:
    """Stands where the car would: the refusal comes before anything is driven."""

    def clock(self, pace: object) -> LockstepClock:
        return LockstepClock(25_000_000, lambda now_ns: None)

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    "arguments",
    [
        ("--duration-s", "0"),
        ("--duration-s", "-4"),
        ("--realtime.cpu", "99999999999999999999999"),
        ("--mpc.horizon", "2"),
    ],
)
def test_a_number_outside_its_range_is_a_usage_error(
    monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, str]
) -> None:
    assert exit_code(monkeypatch, "--bus", "virtual", *arguments) == 2


def test_a_settings_file_that_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    nowhere = str(tmp_path / "nope.toml")
    assert exit_code(monkeypatch, "--config", nowhere, "--bus", "virtual") == 2
    assert "nope.toml" in capsys.readouterr().err.replace("\n", "")


def test_brackets_in_a_message_are_shown_as_they_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--bus", "virtual", "--model", "/tmp/[/x]/[sim]")
    assert exit_code(monkeypatch, *arguments) == 2
    assert "[/x]/[sim]" in capsys.readouterr().err.replace("\n", "")


def test_help_documents_the_exit_codes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, "--help") == 0
    assert "Exit codes" in capsys.readouterr().out
