"""`rt-controller` refuses models that do not fit, and names them in its message."""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_models import make_bundle

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.artifact import (
    find_model,
    load_bundle,
    save_bundle,
    shipped_model,
)
from rt_controller.model.lift import Lift
from rt_controller.terminal import run as terminal_run

Run = Callable[..., tuple[int, str]]
ON_SOCKETCAN = ("--bus", "socketcan", "--channel", "can0")


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
    assert "--model: expected one of mdk-net, mdk-net-paper, lti (did you mean mdk-net?)" in message


def test_all_names_and_ranges_are_refused_in_one_message_before_anything_is_loaded(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal_run, "Bundle", None)
    wrong = {
        "--model": "lit",
        "--scenario": "strait",
        "--car": "none.toml",
        "--friction": "7",
        "--plant": "mine",
        "--mpc.horizon": "2",
    }
    code, message = run("--bus", "virtual", *(part for item in wrong.items() for part in item))
    assert code == 2
    for option, value in wrong.items():
        assert re.search(f"{option}: expected .*, found '{value}'", message), option
    assert "(did you mean straight?)" in message


def test_a_path_is_never_taken_for_a_shipped_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ArtifactError, match=r"'\./lti'.*\(did you mean lti\?\)"):
        find_model("./lti")
    for folder in ("./lti", "runs/lti"):
        Path(folder).mkdir(parents=True)
        assert find_model(folder) == Path(folder)


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
    assert "expected format_version = 4, found 1" in message
    assert "Run offline-export RUN again" in message


def test_a_model_with_another_period_is_refused(run: Run, tmp_path: Path) -> None:
    slower = replace(make_bundle(Lift()), schema=replace(VEHICLE, dt_s=2.0 * VEHICLE.dt_s))
    save_bundle(tmp_path, slower, "card")
    code, message = run(*ON_SOCKETCAN, "--model", tmp_path)
    assert code == 2
    assert f"expected period in s = {VEHICLE.dt_s:g}, found {2.0 * VEHICLE.dt_s:g}" in message
