"""A model that does not hold or predict the simulated car is not exported."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from offline.commands import model_trial
from offline.commands.model_trial import (
    LARGEST,
    prediction_errors,
    require_passed,
    trial_figures,
    try_model,
)
from rt_controller.contract.errors import ArtifactError, MissingExtraError
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.path_kinematics import Movement
from rt_controller.simulation import simulate


@pytest.fixture
def lti() -> Bundle:
    return load_bundle(shipped_model("lti"))


@pytest.mark.parametrize(
    ("is_good", "result"),
    [
        (True, {}),
        *((False, {name: 1.001 * limit}) for name, limit in LARGEST._asdict().items()),
        (False, {"stop_cause": "TRACKING_LOST"}),
        (False, {"ey_peak_m": float("nan")}),
    ],
)
def test_a_drive_passes_within_all_limits_and_without_a_safe_stop(is_good, result):
    cause = {"stop_cause": "NONE", **result}.pop("stop_cause")
    drive = SimpleNamespace(model="lti 1234", ending="an end", stop_cause=cause)
    found = LARGEST._replace(**{name: x for name, x in result.items() if name != "stop_cause"})
    refusal = pytest.raises(ArtifactError, match=r"expected .* found .*--model-trial off")
    with nullcontext() if is_good else refusal:
        require_passed(drive, found)


def test_a_model_of_logs_or_without_the_simulated_car_is_not_tried(lti, monkeypatch):
    def miss(*_, **__):
        raise MissingExtraError("no compiler")

    monkeypatch.setattr(model_trial, "simulate", miss)
    for bundle, words in (
        (replace(lti, training='{"data": "imported"}'), "its data are logs of another"),
        (replace(lti, schema=replace(VEHICLE, dt_s=0.05)), "cannot be driven with"),
        (lti, "not compiled here"),
    ):
        text, figures = try_model(bundle)
        assert text.startswith("not tried on the simulated car")
        assert words in text
        assert figures is None


def test_a_drive_without_half_a_second_of_nominal_driving_predicts_nothing(lti):
    drive = simulate("stop_and_hold", model=lti, duration_s=0.1)
    assert prediction_errors(drive, lti).shape == (0, 6)
    with pytest.raises(ArtifactError, match="nan"):
        require_passed(drive, trial_figures(drive, lti))


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
    wrong = replace(wrong, plans=None)  # as in a wrong export
    is_found = pytest.raises(ArtifactError, match="hold and to predict")
    with nullcontext() if what == "nothing" else is_found:
        try_model(wrong)
