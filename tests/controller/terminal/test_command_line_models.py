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


def test_a_shipped_model_is_found_by_its_name() -> None:
    assert find_model("lti") == shipped_model("lti")
    assert find_model(None) == shipped_model("mdk-net")


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


def empty(folder: Path) -> None:
    folder.mkdir()


def mixed(folder: Path) -> None:
    shutil.copytree(shipped_model("mdk-net-paper"), folder)
    shutil.copy(shipped_model("lti") / "encoder.onnx", folder / "encoder.onnx")


def older(folder: Path) -> None:
    save_bundle(folder, load_bundle(shipped_model("lti")), "card")
    with np.load(folder / "koopman.npz") as archive:
        arrays = dict(archive)
    np.savez(folder / "koopman.npz", **{**arrays, "format_version": np.int64(1)})


def slower(folder: Path) -> None:
    schema = replace(VEHICLE, dt_s=0.05)
    save_bundle(folder, replace(make_bundle(Lift()), schema=schema), "card")


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (empty, "koopman.npz"),
        (mixed, "SHA-256"),
        (older, "expected format_version = 5, found 1"),
        (slower, "expected period in s = 0.025, found 0.05"),
    ],
)
def test_a_folder_with_another_bundle_is_refused(
    run: Run, tmp_path: Path, make: Callable[[Path], None], expected: str
) -> None:
    make(tmp_path / "model")
    code, message = run("--bus", "socketcan", "--channel", "can0", "--model", tmp_path / "model")
    assert code == 2
    assert expected in message
