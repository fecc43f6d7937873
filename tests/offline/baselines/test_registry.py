"""Baselines by name: rows of a table, fitted once, and kept in the cache."""

import subprocess
import sys
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from made_drives import drive, predict

from offline.baselines import catalogue, registry
from offline.baselines.baseline import Baseline
from offline.baselines.scheduled import ScheduledSettings, fit_scheduled
from rt_controller.contract.errors import ConfigError, DatasetError

NAMES = {
    "persistence", "lti", "lti-per-curvature", "dmdc-delays-path", "lti-scheduled-delays",
    "edmd-bilinear", "gru",
}  # fmt: skip


def test_the_catalogue_has_all_baselines():
    assert set(registry.names()) == NAMES


def test_every_linear_and_every_recurrent_baseline_is_marked_as_one():
    marked = {name: registry.find_baseline(name).model_class for name in registry.names()}
    linear = {"lti", "lti-per-curvature", "dmdc-delays-path", "lti-scheduled-delays"}
    assert {name for name, found in marked.items() if found == "linear"} == linear
    assert marked["gru"] == "recurrent"
    assert marked["persistence"] == marked["edmd-bilinear"] == "other"


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
        monkeypatch.setitem(catalogue.CATALOGUE, name, baseline)
    assert "mean" in registry.names()
    assert registry.find_baseline("mean").find_objection(toy_dataset) is None
    fitted = registry.fit("mean", toy_dataset).baseline
    predicted, _ = predict(fitted, toy_dataset.select("test"))
    mean = toy_dataset.select("train").x.astype(float).mean(axis=(0, 1))
    assert np.allclose(predicted[:, 1:], mean)


def test_an_unknown_baseline_is_refused_with_all_names(toy_dataset):
    with pytest.raises(ConfigError, match=r"expected one of dmdc-delays-path, .*persistence"):
        registry.fit("crystal-ball", toy_dataset)


@pytest.mark.parametrize("name", ["persistence", "lti", "lti-per-curvature"])
def test_a_baseline_from_the_cache_predicts_the_same(name, toy_dataset):
    windows = toy_dataset.select("test")
    first = registry.fit(name, toy_dataset)
    again = registry.fit(name, toy_dataset)
    assert np.array_equal(predict(first.baseline, windows)[0], predict(again.baseline, windows)[0])
    assert again.fit_cpu_s == first.fit_cpu_s
    assert again.baseline.fit_info() == first.baseline.fit_info()


def with_other_drives(dataset):
    """Other numbers with the same hash, so that a new fit differs from one of the cache."""
    recording = dataset.recording
    return replace(dataset, recording=recording._replace(x=0.5 * recording.x))


def test_a_baseline_is_fitted_once_for_the_same_data_and_code(toy_dataset, monkeypatch):
    first = registry.fit("lti", toy_dataset).baseline.matrices
    altered = with_other_drives(toy_dataset)
    assert np.array_equal(registry.fit("lti", altered).baseline.matrices.c, first.c)
    monkeypatch.setattr(registry, "_code_version", lambda: "0.0.0")
    assert not np.array_equal(registry.fit("lti", altered).baseline.matrices.c, first.c)


def test_other_settings_are_fitted_anew(toy_dataset, monkeypatch):
    ridges = []
    for ridge in (1e-6, 1e-3, 1e-6):
        settings = ScheduledSettings(ridges=(ridge,))
        row = Baseline("linear", partial(fit_scheduled, settings=settings))
        monkeypatch.setitem(catalogue.CATALOGUE, "lti", row)
        ridges.append(registry.fit("lti", toy_dataset).baseline.ridge)
    assert ridges == [1e-6, 1e-3, 1e-6]


def test_other_data_are_fitted_anew(toy_dataset):
    first = registry.fit("lti", toy_dataset).baseline.matrices
    other = registry.fit("lti", drive(lambda x, u, w, b: 0.9 * x)).baseline.matrices
    assert first.A.shape != other.A.shape


@pytest.mark.filterwarnings("ignore:.*:UserWarning")
def test_a_damaged_file_of_the_cache_is_replaced_by_a_new_fit(toy_dataset, tmp_path):
    first = registry.fit("lti", toy_dataset).baseline.matrices
    (file,) = tmp_path.rglob("output.pkl")
    file.write_bytes(file.read_bytes()[:-30])
    assert np.array_equal(registry.fit("lti", toy_dataset).baseline.matrices.c, first.c)
    altered = with_other_drives(toy_dataset)
    assert np.array_equal(registry.fit("lti", altered).baseline.matrices.c, first.c)


def test_a_cache_that_cannot_be_written_is_named(toy_dataset, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(ConfigError, match="XDG_CACHE_HOME"):
        registry.fit("lti", toy_dataset)


def test_a_baseline_that_does_not_fit_the_data_is_refused_and_not_cached(tmp_path):
    with pytest.raises(DatasetError, match="lti-per-curvature"):
        registry.fit("lti-per-curvature", drive(lambda x, u, w, b: 0.9 * x))
    assert not list(tmp_path.rglob("output.pkl"))


def test_objections_to_data_are_found_without_a_fit(toy_dataset):
    other = drive(lambda x, u, w, b: 0.9 * x)
    baselines = {name: registry.find_baseline(name) for name in registry.names()}
    refused = {name for name, baseline in baselines.items() if baseline.find_objection(other)}
    assert refused == {"lti-per-curvature"}
    assert not any(baseline.find_objection(toy_dataset) for baseline in baselines.values())


def test_names_are_listed_and_plain_baselines_imported_without_torch():
    """In a fresh process, since other tests import torch."""
    code = (
        "import sys; from offline.baselines import registry; registry.names(); "
        "[registry.find_baseline(name) for name in registry.names()]; "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
