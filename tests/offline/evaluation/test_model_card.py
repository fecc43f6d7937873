"""The model card of a bundle."""

from dataclasses import replace

import numpy as np
import pytest
from toy_predictors import made_test_set, made_trajectories, with_random_error

from offline.evaluation.comparison import compare_models
from offline.evaluation.model_card import model_facts, write_card
from offline.model.export_checks import check_export
from rt_controller.contract.model.artifact import load_bundle, shipped_model
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.model.lift import Lift
from rt_controller.contract.schema import VEHICLE
from rt_controller.report.table import Fact, format_number


@pytest.fixture(scope="module")
def lti():
    shipped = load_bundle(shipped_model("lti"))
    return replace(shipped, A=0.95 * shipped.A)


def test_card_has_facts_hashes_and_every_error_with_its_interval(lti):
    made = made_trajectories(60)
    models = {"lti": with_random_error(made)}
    baselines = {"persistence": with_random_error(made, 2.0)}
    comparison = compare_models(models, baselines, [made_test_set(made)], VEHICLE)
    card = write_card(lti, check_export(lti), comparison, [Fact("preset", "tiny")])
    assert "| preset | tiny |" in card
    assert lti.sha256 in card
    for scores in comparison.library.values():
        value, low, high = (float(part[4]) for part in scores.mse())
        interval = f"{format_number(low, 3)}–{format_number(high, 3)}"
        assert f"{format_number(value)} ({interval})" in card


def test_card_says_what_the_lift_uses_and_how_the_inputs_act(lti):
    plain = dict(model_facts(lti))
    assert plain["input matrix"] == "constant"
    assert "curvature" not in plain["observables"]
    n = lti.n_observables
    richer = replace(
        lti,
        lift=Lift(True, 4, ("vx_mps", "steer_rad")),
        bilinear=Bilinear(np.zeros((3, n, 3)), np.zeros((3, 3, n)), np.zeros((3, 3))),
    )
    found = dict(model_facts(richer))
    assert "rank 3, following the lifted state" in found["input matrix"]
    assert "curvature_per_m" in found["observables"]
    assert "the last 4 periods (100 ms) of vx_mps, steer_rad" in found["observables"]
    frozen = replace(richer, bilinear=richer.bilinear._replace(follows=Follow.START))
    assert "rank 3, frozen at the first" in dict(model_facts(frozen))["input matrix"]
