"""All rivals by name, fitted once and found again."""

import ast
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from made_drives import drive, predict

from offline.baselines import roster, shelf
from offline.baselines.edmd import DELAYS
from offline.baselines.linear_model import LinearModel
from offline.baselines.shelf import Kept, keep, place, recall
from rt_controller.contract.errors import ArtifactError, ConfigError, DatasetError


def test_all_rivals_that_a_fair_judge_expects_are_there():
    assert set(roster.names()) >= {
        "persistence",
        "constant-acceleration",
        "lti",
        "lti-per-curvature",
        "lti-horizon",
        "dmdc-delays",
        "edmd-polynomial-66",
        "edmd-rbf-66",
        "edmd-fourier-66",
        "edmd-bilinear-frozen",
        "edmd-bilinear",
        "bicycle",
        "gru",
    }


def test_an_unknown_rival_is_refused_with_the_names_there_are(toy_dataset, tmp_path):
    with pytest.raises(ConfigError, match="persistence, constant-acceleration, lti"):
        roster.fit("crystal-ball", toy_dataset, tmp_path)


@pytest.mark.parametrize("name", ["persistence", "constant-acceleration", "lti", "dmdc-delays"])
def test_a_rival_from_the_shelf_predicts_what_it_predicted_when_it_was_fitted(
    name, toy_dataset, tmp_path
):
    windows = toy_dataset.select("test")
    first, _ = predict(roster.fit(name, toy_dataset, tmp_path), windows)
    (kept,) = tmp_path.iterdir()
    again, _ = predict(roster.fit(name, toy_dataset, tmp_path), windows)
    assert kept.name.startswith(name)
    assert np.array_equal(first, again)


def with_other_drives(dataset):
    """Other numbers under the same hash: whoever looks at them fits something else."""
    recording = dataset.recording
    return replace(dataset, recording=recording._replace(x=0.5 * recording.x))


def test_a_rival_is_fitted_once_to_the_same_data_unless_it_is_asked_for_again(
    toy_dataset, tmp_path
):
    first = roster.fit("lti", toy_dataset, tmp_path)
    altered = with_other_drives(toy_dataset)
    assert np.array_equal(roster.fit("lti", altered, tmp_path).c, first.c)
    again = roster.fit("lti", altered, tmp_path, refit=True)
    assert not np.array_equal(again.c, first.c)
    assert np.array_equal(roster.fit("lti", altered, tmp_path).c, again.c)


def test_other_data_have_a_rival_of_their_own(toy_dataset, tmp_path):
    roster.fit("lti", toy_dataset, tmp_path)
    roster.fit("lti", drive(lambda x, u, w, b: 0.9 * x), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_the_report_says_what_was_found_and_how_long_it_took(toy_dataset, tmp_path):
    found = roster.report("dmdc-delays", toy_dataset, tmp_path)
    assert found.fit_cpu_s > 0.0
    assert roster.report("dmdc-delays", toy_dataset, tmp_path) == found
    assert "past periods" in [finding.name for finding in found.findings]


def test_a_rival_that_does_not_fit_the_data_says_so(tmp_path):
    with pytest.raises(DatasetError, match="lti-per-curvature"):
        roster.fit("lti-per-curvature", drive(lambda x, u, w, b: 0.9 * x), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_rival_that_cannot_be_fitted_is_known_beforehand(toy_dataset):
    strange = drive(lambda x, u, w, b: 0.9 * x)
    unfit = [name for name in roster.names() if roster.find_objection(name, strange)]
    assert unfit == ["lti-per-curvature", "bicycle"]
    assert not any(roster.find_objection(name, toy_dataset) for name in roster.names())


def linear_model():
    return LinearModel(np.eye(2), np.ones((2, 1)), np.zeros((2, 0)), np.array([1.0, np.pi]))


@pytest.mark.parametrize("damage", ["truncated", "another kind", "no archive"])
def test_a_damaged_file_is_refused_with_the_remedy(damage, tmp_path):
    path = tmp_path / "lti.npz"
    keep(path, Kept(linear_model(), 1.0))
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:-30])
    elif damage == "no archive":
        path.write_text("lti")
    else:
        np.savez(path, A=np.eye(2))
    with pytest.raises(ArtifactError, match="Delete it"):
        recall(path, LinearModel)


def test_nothing_on_the_shelf_is_none(tmp_path):
    assert recall(tmp_path / "lti.npz", LinearModel) is None


def test_a_shelf_that_cannot_be_written_to_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ArtifactError, match="expected room"):
        keep(tmp_path / "file" / "lti.npz", Kept(linear_model(), 1.0))


LTI = ("offline.baselines.lti",)


def test_the_place_of_a_rival_depends_on_data_settings_and_code(tmp_path, monkeypatch):
    few, many = DELAYS, replace(DELAYS, most_transitions=10)
    places = {
        place(tmp_path, "dmdc", sha256, settings, LTI)
        for sha256 in ("a", "b")
        for settings in (few, many)
    }
    monkeypatch.setattr(shelf, "digest_of_code", lambda tree: "other code")
    places.add(place(tmp_path, "dmdc", "a", few, LTI))
    assert len(places) == 5


def names_in_the_code_of(monkeypatch, modules):
    seen = []
    monkeypatch.setattr(shelf, "digest_of_code", lambda tree: seen.append(tree) or "")
    shelf.digest_of_modules(modules)
    return {node.name for tree in seen for node in tree.body if hasattr(node, "name")}


def test_the_code_of_a_rival_is_its_module_and_what_that_imports_of_this_package(monkeypatch):
    """The linear model is fitted by least squares, and no network; a network learns from windows
    of drives, by an objective that others share."""
    of_lti = names_in_the_code_of(monkeypatch, LTI)
    assert {"fit_linear", "fit_one_step", "LinearModel", "WindowShape", "fit_scaling"} <= of_lti
    assert "Network" not in of_lti
    of_gru = names_in_the_code_of(monkeypatch, ("offline.baselines.gru",))
    assert {"Network", "WindowSource", "log_error", "TrainingConfig"} <= of_gru


def test_comments_and_docstrings_are_no_part_of_the_code():
    bare = "def f(x):\n    return x\n"
    told = '"""Room."""\ndef f(x):\n    """What."""\n    return (x)  # why\n'
    texts = (bare, told, bare.replace("x\n", "-x\n"))
    digests = [shelf.digest_of_code(ast.parse(text)) for text in texts]
    assert digests[0] == digests[1] != digests[2]


def test_plain_rivals_need_no_torch():
    """A fresh process: other tests have it loaded already."""
    code = (
        "import sys; from offline.baselines import roster; roster.names(); "
        "from offline.baselines import bicycle, edmd, lti, lti_horizon, constant_acceleration; "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=120).returncode == 0
