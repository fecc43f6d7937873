"""Baselines by name: rows of a table, fitted once, kept in the cache, and chosen."""

import subprocess
import sys
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from made_drives import drive, predict

from offline.baselines import registry
from offline.baselines.linear import Persistence
from offline.baselines.registry import (
    BASELINES,
    DEFAULT_BASELINES,
    SHIPPED,
    Baseline,
    choose_baselines,
    open_baselines,
)
from offline.baselines.scheduled import fit_scheduled
from offline.commands.export import compare_with_plain_baselines
from offline.data.manifest import describe_training
from offline.model.bundle_predictor import BundlePredictor
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.model.artifact import load_bundle, shipped_model

CLASSES = {
    "persistence": "other", "lti": "linear", "lti-per-curvature": "linear",
    "dmdc-delays-path": "linear", "lti-scheduled-delays": "linear", "edmd-bilinear": "other",
    "gru": "recurrent",
}  # fmt: skip


def other_data():
    return drive(lambda x, u, w, b: 0.9 * x)


def with_other_drives(dataset):
    """Other numbers with the same hash, so that a new fit differs from one of the cache."""
    recording = dataset.recording
    return replace(dataset, recording=recording._replace(x=0.5 * recording.x))


def offset(dataset):
    return registry.fit("lti", dataset).matrices.c


@pytest.fixture
def fitted(monkeypatch):
    """Names of the fitted baselines; all of them are replaced by one that needs no fit."""
    names = []
    monkeypatch.setattr(
        registry, "fit", lambda name, *arguments: names.append(name) or Persistence()
    )
    return names


def test_the_table_has_all_baselines_which_are_chosen_by_name_all_none_or_by_default():
    assert {name: row.model_class for name, row in BASELINES.items()} == CLASSES
    assert choose_baselines([]) == DEFAULT_BASELINES
    assert choose_baselines(["none"]) == ()
    assert choose_baselines(["all"]) == (*sorted(CLASSES), SHIPPED)
    assert choose_baselines(["gru", "lti", "gru"]) == ("gru", "lti")


def test_the_new_baseline_of_the_guide_is_one_function_and_one_row(
    toy_dataset, tmp_path, monkeypatch
):
    guide = Path(__file__).parents[3] / "docs" / "baselines.md"
    module, row = (
        block.split("```")[0] for block in guide.read_text("utf-8").split("```python\n")[1:3]
    )
    (tmp_path / "mean_state.py").write_text(module)
    monkeypatch.syspath_prepend(str(tmp_path))
    fit_mean = import_module("mean_state").fit_mean
    for name, baseline in eval(f"{{{row}}}", {"Baseline": Baseline, "fit_mean": fit_mean}).items():
        monkeypatch.setitem(BASELINES, name, baseline)
    predicted, _ = predict(registry.fit("mean", toy_dataset), toy_dataset.select("test"))
    mean = toy_dataset.select("train").x.astype(float).mean(axis=(0, 1))
    assert np.allclose(predicted[:, 1:], mean)


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
def test_a_fit_of_the_cache_counts_until_another_release_or_damage(
    toy_dataset, tmp_path, monkeypatch
):
    altered = with_other_drives(toy_dataset)
    first = offset(toy_dataset)
    assert np.array_equal(offset(altered), first)
    monkeypatch.setattr(registry, "version", lambda package: "0.0.0")
    changed = offset(altered)
    assert not np.allclose(changed, first)
    for file in tmp_path.rglob("output.pkl"):
        file.write_bytes(file.read_bytes()[:-30])
    assert np.array_equal(offset(toy_dataset), first)


def test_other_settings_and_other_data_are_fitted_anew(toy_dataset, monkeypatch):
    assert len(offset(other_data())) < len(offset(toy_dataset))
    ridges = []
    for ridge in (1e-6, 1e-3, 1e-6):
        row = Baseline("linear", partial(fit_scheduled, ridges=(ridge,)))
        monkeypatch.setitem(BASELINES, "lti", row)
        ridges.append(registry.fit("lti", toy_dataset).ridge)
    assert ridges == [1e-6, 1e-3, 1e-6]


@pytest.mark.parametrize(
    ("refused", "error", "words"),
    [
        (lambda: registry.fit("crystal-ball", None), ConfigError, "dmdc-delays-path, .*pers"),
        (lambda: choose_baselines(["lti", "all"]), ConfigError, "found all"),
        (lambda: registry.fit("lti-per-curvature", other_data()), DatasetError, "have no roads"),
        (lambda: registry.fit("lti", other_data()), ConfigError, "XDG_CACHE_HOME"),
    ],
)
def test_refusals(refused, error, words, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(error, match=words):
        refused()


def test_names_are_listed_and_plain_baselines_imported_without_torch():
    """In a fresh process, since other tests import torch."""
    code = "import sys; from offline.baselines import registry; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0


def test_a_baseline_that_may_have_been_trained_on_test_episodes_is_left_out_or_refused(
    toy_dataset, fitted, monkeypatch
):
    """The paper's network is trained on 7,000 episodes of the seed of these data."""
    origin = replace(toy_dataset.origin, episodes=7_000)
    shipped = load_bundle(shipped_model(SHIPPED))
    shipped = replace(shipped, training=describe_training({}, origin))
    monkeypatch.setattr(registry, "load_bundle", lambda folder: shipped)
    said, begun = [], []
    opened = open_baselines(DEFAULT_BASELINES, toy_dataset, [], False, said.append, begun.append)
    assert tuple(opened) == tuple(fitted) == tuple(begun) == DEFAULT_BASELINES[:-1]
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


def test_a_bundle_with_the_name_of_a_baseline_replaces_it(toy_dataset):
    shipped = load_bundle(shipped_model("lti"))
    errors = []
    for bundle in (replace(shipped, A=0.9 * shipped.A), shipped):
        comparison = compare_with_plain_baselines(bundle, toy_dataset)
        assert comparison.models == ("lti",)
        assert comparison.baselines == ("lti-per-curvature", "persistence")
        errors.append(comparison.library["lti"][0].mse)
    assert errors[0] > errors[1]
