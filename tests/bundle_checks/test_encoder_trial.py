"""An encoder runs for the first time where it can neither hang nor fill this process."""

import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnx_bytes
import pytest
from made_models import make_bundle

from rt_controller.bundle_checks import encoder_trial
from rt_controller.contract import user_cache
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.artifact import load_bundle, shipped_model
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.lift import Lift


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(encoder_trial, "_tried", set())
    return tmp_path


@pytest.fixture
def bundle() -> Bundle:
    return make_bundle(Lift())


def ends_with(code: int, monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """The calls of a process that ends with that code."""
    calls: list[object] = []

    def run(*arguments: object, **_: object) -> SimpleNamespace:
        calls.append(arguments)
        return SimpleNamespace(returncode=code, stderr=b"")

    monkeypatch.setattr(subprocess, "run", run)
    return calls


def too_large() -> bytes:
    """An encoder that makes 64 GiB of zeros from a few bytes."""
    return onnx_bytes.model(
        [
            onnx_bytes.node("ConstantOfShape", ["shape"], "zeros"),
            onnx_bytes.node("ReduceSum", ["zeros"], "sum"),
            onnx_bytes.node("Add", ["x", "sum"], "psi"),
        ],
        [onnx_bytes.value("x", ("batch", 6))],
        [onnx_bytes.value("psi", ("batch", 6))],
        [onnx_bytes.constant("shape", np.array([1 << 20, 1 << 14]))],
    )


def test_an_encoder_that_fills_the_memory_is_refused(bundle: Bundle) -> None:
    large = replace(bundle, encoder_onnx=too_large())
    with pytest.raises(ArtifactError, match=r"within 10 s .* 2 GiB, found"):
        encoder_trial.require_bounded(large)


@pytest.mark.parametrize("code", [-9, -24, 1, encoder_trial.TOO_LARGE])
def test_a_process_that_is_ended_refuses_the_encoder_every_time(
    code: int, bundle: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = ends_with(code, monkeypatch)
    for _ in range(2):
        with pytest.raises(ArtifactError, match=r"expected .* found .*offline-export"):
            encoder_trial.require_bounded(bundle)
    assert len(calls) == 2


def test_an_endless_encoder_is_refused_after_the_limit(
    bundle: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*_: object, timeout: float, **__: object) -> None:
        raise subprocess.TimeoutExpired("encoder", timeout)

    monkeypatch.setattr(subprocess, "run", run)
    with pytest.raises(ArtifactError, match="more than 120 s"):
        encoder_trial.require_bounded(bundle)


def test_an_encoder_is_tried_once_on_a_machine(
    bundle: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = ends_with(0, monkeypatch)
    encoder_trial.require_bounded(bundle)
    encoder_trial.require_bounded(bundle)
    encoder_trial._tried.clear()
    encoder_trial.require_bounded(bundle)
    assert len(calls) == 1


def test_without_a_cache_folder_it_is_tried_once_in_a_process(
    bundle: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = ends_with(0, monkeypatch)
    monkeypatch.setattr(user_cache, "user_cache_folder", lambda: None)
    encoder_trial.require_bounded(bundle)
    encoder_trial.require_bounded(bundle)
    assert len(calls) == 1


def test_the_identity_needs_no_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = ends_with(-9, monkeypatch)
    encoder_trial.require_bounded(load_bundle(shipped_model("lti")))
    assert not calls
