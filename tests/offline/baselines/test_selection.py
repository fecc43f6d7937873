"""Which baselines an evaluation has."""

from dataclasses import replace

import pytest

from offline.baselines import registry
from offline.baselines.linear import Persistence
from offline.baselines.registry import (
    DEFAULT_BASELINES,
    SHIPPED,
    Fitted,
    all_baselines,
    baseline_facts,
    choose_baselines,
    compare_with_plain_baselines,
    not_converged,
    open_baselines,
)
from offline.data.manifest import describe_training
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.model.artifact import load_bundle, shipped_model


@pytest.fixture
def fitted(monkeypatch):
    """Names of the fitted baselines; all of them are replaced by one that needs no fit."""
    names = []
    monkeypatch.setattr(
        registry,
        "fit",
        lambda name, dataset: names.append(name) or Fitted(Persistence(), 0.5),
    )
    return names


@pytest.fixture
def shipped_of_same_seed(toy_dataset, monkeypatch):
    """The paper's network, trained on 7,000 episodes of the seed of the toy data."""
    origin = replace(toy_dataset.origin, episodes=7_000)
    shipped = load_bundle(shipped_model(SHIPPED))
    shipped = replace(shipped, training=describe_training({}, origin))
    monkeypatch.setattr(registry, "load_bundle", lambda folder: shipped)


def test_baselines_are_chosen_by_name_all_none_or_by_default():
    assert choose_baselines([]) == DEFAULT_BASELINES
    assert choose_baselines(["none"]) == ()
    assert choose_baselines(["all"]) == all_baselines()
    assert SHIPPED in all_baselines()
    assert choose_baselines(["gru", "lti", "gru"]) == ("gru", "lti")


@pytest.mark.parametrize("names", [["grue"], ["lti", "all"]])
def test_an_unknown_baseline_is_refused_with_all_names(names):
    with pytest.raises(ConfigError, match="dmdc-delays-path, edmd-bilinear"):
        choose_baselines(names)


def test_a_baseline_that_may_have_been_trained_on_test_episodes_is_left_out_or_refused(
    toy_dataset, fitted, shipped_of_same_seed
):
    said = []
    opened = open_baselines(DEFAULT_BASELINES, toy_dataset, [], False, said.append)
    assert tuple(opened) == tuple(fitted) == DEFAULT_BASELINES[:-1]
    assert said == [f"without {SHIPPED}: {SHIPPED} may have been trained on its test episodes."]
    fitted.clear()
    with pytest.raises(DatasetError, match=SHIPPED):
        open_baselines(["lti", SHIPPED], toy_dataset, [], is_required=True)
    assert fitted == []


def test_the_papers_network_is_a_baseline_of_other_models_only(toy_dataset, monkeypatch):
    shipped = load_bundle(shipped_model(SHIPPED))
    shipped = replace(shipped, data_sha256=toy_dataset.sha256)
    monkeypatch.setattr(registry, "load_bundle", lambda folder: shipped)
    other = load_bundle(shipped_model("lti"))
    opened = open_baselines([SHIPPED], toy_dataset, [other], is_required=False)
    assert isinstance(opened[SHIPPED], BundlePredictor)
    assert open_baselines([SHIPPED], toy_dataset, [other, shipped], is_required=False) == {}


def test_data_without_roads_have_no_model_per_road(toy_dataset, fitted):
    data = replace(toy_dataset, manifest=replace(toy_dataset.manifest, roads=None))
    said = []
    names, begun = ["lti-per-curvature", "lti"], []
    opened = open_baselines(names, data, [], False, said.append, on_progress=begun.append)
    assert list(opened) == begun == ["lti"]
    assert "no roads" in said[0]


def test_facts_of_a_baseline_have_what_the_fit_found_and_its_time(toy_dataset):
    names = [fact.name for fact in baseline_facts("lti", toy_dataset)]
    assert names == ["spectral radius", "CPU time of the fit"]
    assert baseline_facts(SHIPPED, toy_dataset)[0].name == "model, SHA-256"


def test_a_bundle_with_the_name_of_a_baseline_replaces_it(toy_dataset):
    shipped = load_bundle(shipped_model("lti"))
    worse = replace(shipped, A=0.9 * shipped.A)
    errors = []
    for bundle in (worse, shipped):
        comparison = compare_with_plain_baselines(bundle, toy_dataset)
        assert comparison.models == ("lti",)
        assert comparison.baselines == ("lti-per-curvature", "persistence")
        errors.append(comparison.library["models"]["lti"]["mse"]["vx_kmh_squared"]["value"])
    assert errors[0] > errors[1]


def test_a_network_whose_training_did_not_converge_is_named():
    class Unfinished(Persistence):
        is_converged = False

    assert not_converged({"lti": Persistence(), "gru": Unfinished()}) == ("gru",)
