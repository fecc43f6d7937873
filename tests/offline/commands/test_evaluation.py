"""The work of offline-evaluate."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from toy_predictors import made_trajectories

from offline.baselines import registry
from offline.baselines.linear import Persistence
from offline.baselines.registry import SHIPPED
from offline.commands import evaluate as work
from offline.commands.evaluate import evaluate, label_models, open_sets, run_evaluation
from offline.data.manifest import Imported, describe_training
from offline.evaluation import lane_change, simulated_sets
from offline.evaluation.simulated_sets import SIMULATED, open_simulated_set
from offline.evaluation.test_sets import ROBUSTNESS, SET_NAMES
from rt_controller.contract.errors import ConfigError
from rt_controller.model.artifact import load_bundle, save_bundle, shipped_model
from sim_bridge.scenario import load_scenario

SHOWN = (ROBUSTNESS, "friction-0.5", "nominal", "mass-0.85")
NOISY = ("noise-1", "noise-3")
FEW = tuple(replace(each, episodes=3) for each in SIMULATED if each.name in SHOWN)


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    """An empty cache, baselines that need no fit, and a few simulated sets of three episodes."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(work, "LATEST_RUN", Path("no/such/run"))
    monkeypatch.setattr(registry, "fit", lambda *arguments: Persistence())
    monkeypatch.setattr(simulated_sets, "SIMULATED", FEW)


@pytest.fixture
def bundle_of(toy_dataset, tmp_path):
    """Writes a linear bundle of the toy data to a folder of that name."""

    def write(name, **changes):
        bundle = replace(
            load_bundle(shipped_model("lti")),
            training=describe_training({}, toy_dataset.origin),
            data_sha256=toy_dataset.sha256,
            **changes,
        )
        save_bundle(tmp_path / name, bundle, "card")
        return tmp_path / name

    return write


def test_all_baselines_are_those_that_these_data_allow(toy_folder, bundle_of):
    evaluation = run_evaluation([bundle_of("m")], toy_folder, ["all"], ["library"])
    assert evaluation.comparison.baselines == (*registry.BASELINES, SHIPPED)


def test_a_set_is_left_out_for_a_model_trained_on_its_episodes(toy_dataset, bundle_of, capsys):
    others, _ = open_simulated_set(FEW[0])
    trained = replace(
        load_bundle(bundle_of("a")),
        training=describe_training({}, replace(others.origin, episodes=50)),
    )
    names = ("library", "new-roads", ROBUSTNESS)
    tests = open_sets(names, toy_dataset, [trained])
    assert [test.name for test in tests] == ["library", "new-roads"]
    assert "without robustness" in capsys.readouterr().err


def test_sets_of_the_simulated_car_are_left_out_for_other_data(toy_dataset, bundle_of, capsys):
    imported = Imported((), "", 40, 0)
    dataset = replace(toy_dataset, manifest=replace(toy_dataset.manifest, origin=imported))
    tests = open_sets(SET_NAMES, dataset, [load_bundle(bundle_of("a"))])
    assert [test.name for test in tests] == ["library", "new-roads", "bends-left", *NOISY]
    found = capsys.readouterr().err
    left_out = "robustness, friction, mass, braking"
    assert f"without {left_out}: the data are not" in found


def test_models_are_named_by_their_folder_and_bundles_of_runs_by_the_run(tmp_path):
    folders = [tmp_path / "runs/a/bundle", tmp_path / "runs/b/bundle", tmp_path / "lti"]
    assert label_models(folders) == ("a", "b", "lti")
    twins = [tmp_path / "x/net", tmp_path / "y/net"]
    assert label_models(twins) == ("x/net", "y/net")
    assert label_models([tmp_path / "x/lti"], taken=["lti"]) == ("x/lti",)
    with pytest.raises(ConfigError, match="twice"):
        label_models([tmp_path / "a", tmp_path / "a"])


def test_several_models_are_evaluated_on_every_set(bundle_of, toy_folder, capsys, tmp_path):
    models = [bundle_of("good"), bundle_of("bad", c=load_bundle(shipped_model("lti")).c + 0.01)]
    baselines = ["persistence", "lti"]
    evaluate(model=models, data=toy_folder, baselines=baselines, json_file=tmp_path / "all.json")
    figures = json.loads((tmp_path / "all.json").read_text())
    assert figures["models"] == ["good", "bad"]
    assert figures["baselines"] == baselines
    assert figures["data_sha256"]
    assert figures["model_sha256"]["good"] != figures["model_sha256"]["bad"]
    assert [part["part"] for part in figures["parts"] if part["is_whole_set"]] == [
        "library", "new-roads", "bends-left",
        *(each.name for each in FEW), "braking", "noise-1", "noise-3",
    ]  # fmt: skip
    assert figures["parts"][0]["best_linear"] == "lti"
    errors = {
        row["model"]: row["mse"]
        for row in figures["rows"]
        if (row["part"], row["state"]) == ("library", "ey")
    }
    assert errors["good"] < errors["bad"]
    assert errors["persistence"] == errors["lti"]
    printed = capsys.readouterr().out
    assert "good" in printed
    assert "persistence" in printed
    assert "fair lti" not in printed


def test_the_page_is_of_the_same_evaluation(bundle_of, toy_folder, tmp_path, monkeypatch):
    windows = made_trajectories(lane_change.WINDOWS)
    driven = lane_change.LaneChange(
        load_scenario(lane_change.SCENARIO), windows, windows.x[..., 4].astype(float)
    )
    monkeypatch.setattr(lane_change, "drive_lane_change", lambda: driven)
    page, options = tmp_path / "page.html", {"baselines": ["lti"], "sets": ["library"]}
    evaluate(model=[bundle_of("good")], data=toy_folder, **options, html=page)
    html = page.read_text()
    assert "Double lane change" in html
