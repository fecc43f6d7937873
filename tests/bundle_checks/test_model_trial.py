"""A model drives the simulated car before it drives another one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rt_controller.bundle_checks import model_trial
from rt_controller.bundle_checks.model_trial import (
    LARGEST,
    drive_trial,
    has_passed,
    prediction_errors,
    require_passed,
    try_model,
)
from rt_controller.config import ControllerConfig, MpcSettings
from rt_controller.contract import files
from rt_controller.contract.errors import ArtifactError, MissingExtraError
from rt_controller.loop import Ending
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.simulation import simulate

CONFIG = ControllerConfig()
Drives = Callable[..., list[object]]


@pytest.fixture
def lti() -> Bundle:
    return load_bundle(shipped_model("lti"))


@pytest.fixture
def drives(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Drives:
    """Replace the drive by one with these results; what it returns lists the calls."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def replace_drive(ending: Ending = Ending.MISSION_OVER, **figures: float) -> list[object]:
        calls: list[object] = []
        drive = SimpleNamespace(model="lti 1234", ending=ending.value)
        found = LARGEST._replace(**figures)
        monkeypatch.setattr(model_trial, "trial_figures", lambda *_: found)
        monkeypatch.setattr(
            model_trial, "simulate", lambda *arguments, **_: calls.append(arguments) or drive
        )
        return calls

    return replace_drive


def test_a_model_has_passed_with_the_settings_of_its_trial_only(
    lti: Bundle, drives: Drives
) -> None:
    calls = drives()
    assert not has_passed(lti, CONFIG)
    assert try_model(lti, CONFIG) is None
    assert has_passed(lti, CONFIG)
    assert not has_passed(lti, ControllerConfig(mpc=MpcSettings(horizon=10)))
    assert not has_passed(replace(lti, B_uc=-lti.B_uc), CONFIG)
    try_model(lti, CONFIG)
    assert len(calls) == 2


def test_without_a_cache_folder_no_model_has_passed(
    lti: Bundle, drives: Drives, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives()
    monkeypatch.setattr(files, "user_cache_folder", lambda: None)
    assert try_model(lti, CONFIG) is None
    assert not has_passed(lti, CONFIG)


@pytest.mark.parametrize(
    "result",
    [
        *({name: 1.001 * limit} for name, limit in LARGEST._asdict().items()),
        {"ending": Ending.SAFE_STOPPED},
        {"ey_peak_m": float("nan")},
    ],
)
def test_a_model_that_does_not_hold_the_car_is_refused(
    lti: Bundle, drives: Drives, result: dict[str, object]
) -> None:
    drives(**result)
    with pytest.raises(ArtifactError, match=r"expected .* found .*--model-trial off"):
        try_model(lti, CONFIG)
    assert not has_passed(lti, CONFIG)


def test_without_the_simulated_car_there_is_a_remark(
    lti: Bundle, drives: Drives, monkeypatch: pytest.MonkeyPatch
) -> None:
    def miss(*_: object, **__: object) -> None:
        raise MissingExtraError("no compiler")

    drives()
    monkeypatch.setattr(model_trial, "simulate", miss)
    assert try_model(lti, CONFIG) == model_trial.NOT_TRIED


def swap_pedals(bundle: Bundle) -> Bundle:
    return replace(bundle, B_uc=bundle.B_uc[:, [1, 0, 2]])


def scale_inputs(factor: float, column: int | None = None) -> Callable[[Bundle], Bundle]:
    """B_uc, or one column of it, times `factor`."""
    factors = np.where(np.arange(3) == column, factor, 1.0) if column is not None else factor
    return lambda bundle: replace(bundle, B_uc=bundle.B_uc * factors)


def scale_curvature(factor: float) -> Callable[[Bundle], Bundle]:
    return lambda bundle: replace(bundle, B_uw=bundle.B_uw * factor)


def permute_latents(bundle: Bundle) -> Bundle:
    """The latents of the encoder in another order than those of A."""
    latents = np.random.default_rng(0).permutation(np.arange(6, bundle.n_observables))
    return replace(bundle, A=bundle.A[:, [*range(6), *latents]])


def forget_offset(bundle: Bundle) -> Bundle:
    return replace(bundle, c=np.zeros_like(bundle.c))


WRONG = {
    "swapped pedals": swap_pedals,
    "inputs x 0.5": scale_inputs(0.5),
    "inputs x 2": scale_inputs(2.0),
    "inputs x -1": scale_inputs(-1.0),
    "steering x 0.5": scale_inputs(0.5, 2),
    "brake x -1": scale_inputs(-1.0, 1),
    "curvature x -1": scale_curvature(-1.0),
    "curvature x 0": scale_curvature(0.0),
    "curvature x 0.5": scale_curvature(0.5),
    "curvature x 2": scale_curvature(2.0),
    "permuted latents": permute_latents,
    "no offset": forget_offset,
}
DAILY = [("lti", "inputs x 0.5"), ("lti", "curvature x -1"), ("mdk-net", "permuted latents")]
NOT_FOUND = {("lti", "permuted latents"), ("lti", "no offset")}
"""the linear model has no latents, and an offset that is small"""
MODELS = ["lti", "mdk-net", "mdk-net-paper"]


def find_with_trial(bundle: Bundle) -> None:
    """The drive of the trial, judged; the stored plans are left out, as in a wrong export."""
    wrong = replace(bundle, plans=None)
    require_passed(drive_trial(wrong), wrong)


@pytest.mark.parametrize(
    ("model", "what"),
    [
        pytest.param(*case, marks=[] if case in DAILY else [pytest.mark.nightly])
        for case in ((model, what) for model in MODELS for what in WRONG)
        if case not in NOT_FOUND
    ],
)
def test_a_wrong_model_whose_plans_were_made_from_it_is_found(model: str, what: str) -> None:
    with pytest.raises(ArtifactError, match="hold and to predict"):
        find_with_trial(WRONG[what](load_bundle(shipped_model(model))))


@pytest.mark.parametrize(
    "model", ["lti", "mdk-net", pytest.param("mdk-net-paper", marks=pytest.mark.nightly)]
)
def test_a_shipped_model_passes(model: str) -> None:
    find_with_trial(load_bundle(shipped_model(model)))


def test_a_drive_without_half_a_second_of_nominal_driving_predicts_nothing(lti: Bundle) -> None:
    drive = simulate("stop_and_hold", model=lti, duration_s=0.1)
    assert prediction_errors(drive, lti).shape == (0, 6)
    with pytest.raises(ArtifactError, match="nan"):
        require_passed(drive, lti)
