"""A bundle plans as where it was exported and drives the simulated car, or is refused."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from itertools import product
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
from rt_controller.bundle_checks.plan_check import SITUATIONS, require_stored_plans, with_plans
from rt_controller.config import ControllerConfig, MpcSettings
from rt_controller.contract.errors import ArtifactError, MissingExtraError
from rt_controller.contract.signals import VEHICLE
from rt_controller.loop import Ending
from rt_controller.model.artifact import load_bundle, save_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.path_kinematics import Movement
from rt_controller.node import build_mpc
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


def test_a_model_has_passed_with_the_settings_of_its_trial_only(lti, drives):
    calls = drives()
    assert not has_passed(lti, CONFIG)
    assert try_model(lti, CONFIG) is None
    assert has_passed(lti, CONFIG)
    assert not has_passed(lti, ControllerConfig(mpc=MpcSettings(horizon=10)))
    assert not has_passed(replace(lti, B_uc=-lti.B_uc), CONFIG)
    try_model(lti, CONFIG)
    assert len(calls) == 2


@pytest.mark.parametrize(
    "result",
    [
        *({name: 1.001 * limit} for name, limit in LARGEST._asdict().items()),
        {"ending": Ending.SAFE_STOPPED},
        {"ey_peak_m": float("nan")},
    ],
)
def test_a_model_that_does_not_hold_the_car_is_refused(lti, drives, result):
    drives(**result)
    with pytest.raises(ArtifactError, match=r"expected .* found .*--model-trial off"):
        try_model(lti, CONFIG)
    assert not has_passed(lti, CONFIG)


def test_without_the_simulated_car_there_is_a_remark(lti, drives, monkeypatch):
    def miss(*_, **__):
        raise MissingExtraError("no compiler")

    drives()
    monkeypatch.setattr(model_trial, "simulate", miss)
    assert try_model(lti, CONFIG) == model_trial.NOT_TRIED


def find_with_trial(bundle: Bundle) -> None:
    """The drive of the trial, judged; the stored plans are left out, as in a wrong export."""
    wrong = replace(bundle, plans=None)
    require_passed(drive_trial(wrong), wrong)


def test_a_drive_without_half_a_second_of_nominal_driving_predicts_nothing(lti):
    drive = simulate("stop_and_hold", model=lti, duration_s=0.1)
    assert prediction_errors(drive, lti).shape == (0, 6)
    with pytest.raises(ArtifactError, match="nan"):
        require_passed(drive, lti)


def permute_latents(bundle: Bundle) -> Bundle:
    """The latents of the encoder in another order than those of A."""
    latents = np.random.default_rng(0).permutation(np.arange(6, bundle.n_observables))
    return replace(bundle, A=bundle.A[:, [*range(6), *latents]])


def turn_the_road(bundle: Bundle) -> Bundle:
    """The car turns the other way on its road."""
    if bundle.movement is None:
        return replace(bundle, B_uw=-bundle.B_uw)
    S, s0 = bundle.movement
    return replace(bundle, movement=Movement(S * [[1.0], [1.0], [-1.0]], s0))


WRONG = {
    "nothing": lambda bundle: bundle,
    "pedals": lambda bundle: replace(bundle, B_uc=bundle.B_uc[:, [1, 0, 2]]),
    "inputs": lambda bundle: replace(bundle, B_uc=0.5 * bundle.B_uc),
    "steering": lambda bundle: replace(bundle, B_uc=bundle.B_uc * np.array([1.0, 1.0, 0.5])),
    "curvature": turn_the_road,
    "latents": permute_latents,
    "offset": lambda bundle: replace(bundle, c=np.zeros_like(bundle.c)),
}
DAILY = [("lti", "nothing"), ("mdk-net", "nothing"), ("lti", "curvature"), ("mdk-net", "latents")]
NOT_FOUND = {("lti", "latents"), ("lti", "offset")}
"""the linear model has no latents, and an offset that is small"""


@pytest.mark.parametrize(
    ("model", "what"),
    [
        pytest.param(*case, marks=[] if case in DAILY else [pytest.mark.nightly])
        for case in product(["lti", "mdk-net", "mdk-net-paper"], WRONG)
        if case not in NOT_FOUND
    ],
)
def test_a_shipped_model_passes_and_a_wrong_one_whose_plans_were_made_from_it_is_found(model, what):
    wrong = WRONG[what](load_bundle(shipped_model(model)))
    is_found = pytest.raises(ArtifactError, match="hold and to predict")
    with nullcontext() if what == "nothing" else is_found:
        find_with_trial(wrong)


@pytest.fixture(scope="module", params=["lti", "mdk-net"])
def exported(request: pytest.FixtureRequest) -> Bundle:
    return with_plans(load_bundle(shipped_model(request.param)))


def test_plans_are_stored_and_repeated_from_the_files(exported, tmp_path):
    save_bundle(tmp_path, exported, "card")
    loaded = load_bundle(tmp_path)
    _, brake_n, steer_rad = np.moveaxis(loaded.plans.inputs, 2, 0)
    assert brake_n.max() > 1.0
    assert steer_rad.min() < -0.05 < 0.05 < steer_rad.max()
    assert loaded.plans.inputs.shape == (len(SITUATIONS), 20, 3)
    assert loaded.sha256 == exported.sha256
    require_stored_plans(loaded)


@pytest.mark.parametrize("part", ["A", "B_uc", "c", "road"])
def test_another_model_with_a_hash_of_its_own_is_refused(exported, tmp_path, part):
    A, B_uc, B_uw, c, movement = (
        getattr(exported, name) for name in ("A", "B_uc", "B_uw", "c", "movement")
    )
    turned = (
        {"B_uw": -B_uw}
        if movement is None
        else {"movement": movement._replace(s0=movement.s0 + 0.01)}
    )
    changed = {"A": {"A": 1.02 * A}, "B_uc": {"B_uc": -B_uc}, "c": {"c": c + 0.05 * (c != 0.0)}}
    save_bundle(tmp_path, replace(exported, **{**changed, "road": turned}[part]), "card")
    with pytest.raises(ArtifactError, match=r"stored at its export .* found a difference"):
        build_mpc(load_bundle(tmp_path), MpcSettings())


def test_a_model_that_cannot_be_driven_with_gets_no_plans():
    lti = replace(load_bundle(shipped_model("lti")), plans=None)
    slow = replace(lti, schema=replace(VEHICLE, dt_s=0.05))
    assert with_plans(slow).plans is None


def test_plans_over_another_horizon_are_refused(exported):
    short = exported.plans._replace(inputs=exported.plans.inputs[:, :10])
    with pytest.raises(ArtifactError, match="expected stored plans of 20 periods, found plans of"):
        require_stored_plans(replace(exported, plans=short))
