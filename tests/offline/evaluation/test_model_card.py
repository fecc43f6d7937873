"""The model card of a bundle."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import input_gains, join_gains, saturations
from toy_predictors import made_test_set, made_trajectories, with_random_error

from offline.evaluation.comparison import compare_models
from offline.evaluation.model_card import model_facts, write_card
from offline.model.export_checks import BoxStability, DrivenStability, ExportFigures
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import Shape
from rt_controller.model.follow import Follow
from rt_controller.model.lift import Lift
from rt_controller.report.table import Fact, format_number

CHECKS = ExportFigures(
    parity=2.5e-7,
    stability=BoxStability(
        unsaturated=DrivenStability(1.0007, 6.25),
        saturated=DrivenStability(0.9994, 5.5),
        at_states=DrivenStability(1.0123, 17.5),
    ),
    persistence_over_model=np.array([1.5, 2.5, 3.5, 4.5, 5.5, 650.0]),
)


@pytest.fixture(scope="module")
def lti():
    return load_bundle(shipped_model("lti"))


def test_card_has_facts_hashes_and_every_error_with_its_interval(lti):
    made = made_trajectories(60)
    models = {"lti": with_random_error(made)}
    baselines = {"persistence": with_random_error(made, 2.0)}
    comparison = compare_models(models, baselines, [made_test_set(made)], VEHICLE)
    card = write_card(lti, CHECKS, comparison, [Fact("preset", "tiny")])
    assert "| preset | tiny |" in card
    assert lti.sha256 in card
    assert "Under inputs: gains unsaturated: spectral radius 1.00070, growth over 80 s" in card
    assert "steps 6.25; gains saturated: spectral radius 0.99940, growth over 80 steps 5.5;" in card
    assert "gains at states: spectral radius 1.01230, growth over 80 steps 17.5 (at all" in card
    assert "as trained: 2.5e-07" in card
    assert "vx_mps 1.5, vy_mps 2.5, yaw_rate_radps 3.5" in card
    assert "epsi_rad 650" in card
    for model in comparison.library["models"].values():
        value, low, high = model["mse"]["ey_m_squared"].values()
        interval = f"{format_number(low, 3)}–{format_number(high, 3)}"
        assert f"{format_number(value)} ({interval})" in card


def test_card_says_what_the_lift_uses_and_how_the_inputs_act(lti):
    plain = dict(model_facts(lti))
    assert plain["input matrix"] == "constant"
    assert plain["motion without inputs"] == "linear in the lifted state"
    assert "curvature" not in plain["observables"]
    n = lti.n_observables
    richer = replace(
        lti,
        lift=Lift(True, 4, ("vx_mps", "steer_rad")),
        gains=input_gains(np.zeros((3, n, 3)), np.zeros((3, 3, n)), np.zeros((3, 3)), False),
    )
    found = dict(model_facts(richer))
    assert "rank 3, following the lifted state" in found["input matrix"]
    assert "curvature_per_m" in found["observables"]
    assert "the last 4 periods (100 ms) of vx_mps, steer_rad" in found["observables"]
    frozen = replace(richer, gains=richer.gains._replace(follows=Follow.START))
    assert "rank 3, frozen at the first" in dict(model_facts(frozen))["input matrix"]
    shape = np.full(9, Shape.TANH)
    drift = saturations(np.zeros((n, 3)), np.zeros((3, n)), np.zeros(3), np.array([4, 3, 4]), one=4)
    bent = replace(richer, gains=join_gains(richer.gains._replace(shape=shape), drift))
    facts = dict(model_facts(bent))
    assert facts["input matrix"].startswith("saturating, bilinear of rank 3")
    expected = "saturating with rank 2, and 1 products with curvature_per_m"
    assert facts["motion without inputs"] == expected
