"""Baselines by name: found by file name, fitted once, and kept in the cache."""

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_drives import drive, predict

from offline.baselines import catalogue, code_digest, registry
from offline.baselines.baseline import Baseline
from offline.baselines.linear_model import LinearModel
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.model.rollout import Matrices


def test_the_catalogue_has_all_baselines():
    assert set(registry.names()) >= {
        "persistence", "constant-acceleration", "lti", "lti-per-curvature", "lti-horizon",
        "dmdc-delays", "edmd-polynomial-66", "edmd-rbf-66", "edmd-fourier-66", "edmd-polynomial",
        "edmd-rbf", "edmd-fourier", "edmd-bilinear-frozen", "edmd-bilinear", "bicycle", "gru",
        "neural-state-space", "lti-path", "lti-scheduled", "lti-scheduled-delays",
        "lti-scheduled-horizon", "dmdc-delays-path", "edmd-polynomial-path", "edmd-bilinear-path",
    }  # fmt: skip


def test_every_linear_and_every_recurrent_baseline_is_marked_as_one():
    marked = {name: registry.find_baseline(name).model_class for name in registry.names()}
    linear = {
        "lti", "lti-per-curvature", "lti-horizon", "dmdc-delays", "lti-path", "lti-scheduled",
        "lti-scheduled-delays", "lti-scheduled-horizon", "dmdc-delays-path",
    }  # fmt: skip
    assert {name for name, found in marked.items() if found == "linear"} >= linear
    assert marked["gru"] == marked["neural-state-space"] == "recurrent"
    assert {marked[name] for name in ("persistence", "bicycle", "edmd-rbf")} == {"other"}
    assert marked["edmd-bilinear"] == marked["edmd-bilinear-path"] == "other"


def test_the_new_baseline_of_the_guide_is_one_new_file(toy_dataset, tmp_path, monkeypatch):
    guide = Path(__file__).parents[3] / "docs" / "baselines.md"
    code = guide.read_text("utf-8").split("```python\n")[1].split("```")[0]
    (tmp_path / "mean_state.py").write_text(code)
    monkeypatch.setattr(catalogue, "__path__", [*catalogue.__path__, str(tmp_path)])
    assert "mean-state" in registry.names()
    assert registry.find_baseline("mean-state").find_objection(toy_dataset) is None
    fitted = registry.fit("mean-state", toy_dataset).baseline
    predicted, _ = predict(fitted, toy_dataset.select("test"))
    mean = toy_dataset.select("train").x.astype(float).mean(axis=(0, 1))
    assert np.allclose(predicted, mean)


def test_an_unknown_baseline_is_refused_with_all_names(toy_dataset):
    with pytest.raises(ConfigError, match=r"expected one of bicycle, .*persistence"):
        registry.fit("crystal-ball", toy_dataset)


@pytest.mark.parametrize("name", ["persistence", "constant-acceleration", "lti", "dmdc-delays"])
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
    monkeypatch.setattr(registry, "digest_of_code", lambda module: "other code")
    assert not np.array_equal(registry.fit("lti", altered).baseline.matrices.c, first.c)


def test_short_fits_have_a_place_of_their_own_in_the_cache(toy_dataset, monkeypatch):
    def made(scale):
        return lambda dataset: LinearModel(
            Matrices(scale * np.eye(6), *[np.zeros((6, 3))] * 2, None)
        )

    monkeypatch.setattr(
        registry, "find_baseline", lambda name: Baseline(made(1.0), fit_short=made(2.0))
    )
    for is_short, scale in ((True, 2.0), (False, 1.0), (True, 2.0)):
        fitted = registry.fit("lti", toy_dataset, is_short).baseline
        assert fitted.matrices.A[0, 0] == scale


def test_a_baseline_without_a_short_fit_is_fitted_once(toy_dataset):
    first = registry.fit("lti", toy_dataset)
    assert registry.fit("lti", toy_dataset, is_short=True).fit_cpu_s == first.fit_cpu_s


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


@pytest.mark.parametrize("name", ["lti-per-curvature", "bicycle"])
def test_a_baseline_that_does_not_fit_the_data_is_refused_and_not_cached(name, tmp_path):
    with pytest.raises(DatasetError, match=name):
        registry.fit(name, drive(lambda x, u, w, b: 0.9 * x))
    assert not list(tmp_path.rglob("output.pkl"))


def test_objections_to_data_are_found_without_a_fit(toy_dataset):
    other = drive(lambda x, u, w, b: 0.9 * x)
    baselines = {name: registry.find_baseline(name) for name in registry.names()}
    refused = {name for name, baseline in baselines.items() if baseline.find_objection(other)}
    assert refused >= {"bicycle", "lti-per-curvature"}
    assert not any(baseline.find_objection(toy_dataset) for baseline in baselines.values())


def names_in_the_code_of(monkeypatch, module):
    seen = []
    code_digest._digest_and_imports.cache_clear()
    monkeypatch.setattr(code_digest, "digest_of_tree", lambda tree: seen.append(tree) or "")
    code_digest.digest_of_code(module)
    code_digest._digest_and_imports.cache_clear()
    return {node.name for tree in seen for node in tree.body if hasattr(node, "name")}


def test_the_code_of_a_baseline_is_its_module_and_all_that_it_imports(monkeypatch):
    of_lti = names_in_the_code_of(monkeypatch, "offline.baselines.catalogue.lti")
    assert {"fit_linear", "fit_one_step", "LinearModel", "fit_scaling", "roll_out"} <= of_lti
    assert not {"Gated", "WheelForce", "Episode", "find_baseline"} & of_lti
    of_gru = names_in_the_code_of(monkeypatch, "offline.baselines.catalogue.gru")
    assert {"Gated", "WindowSource", "log_error", "TrainingConfig"} <= of_gru


def test_comments_and_docstrings_do_not_change_the_digest():
    bare = "def f(x):\n    return x\n"
    documented = '"""Room."""\ndef f(x):\n    """What."""\n    return (x)  # why\n'
    texts = (bare, documented, bare.replace("x\n", "-x\n"))
    digests = [code_digest.digest_of_tree(ast.parse(text)) for text in texts]
    assert digests[0] == digests[1] != digests[2]


def test_names_are_listed_and_plain_baselines_imported_without_torch():
    """In a fresh process, since other tests import torch."""
    code = (
        "import sys; from offline.baselines import registry; registry.names(); "
        "[registry.find_baseline(name) for name in ('bicycle', 'edmd-rbf', 'lti', 'lti-horizon', "
        "'constant-acceleration')]; "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
