"""Which models, rivals and sets a command takes, and what it says of those it leaves out."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from toy_predictors import Hold

from offline import evaluation_run, rivals
from offline.baselines import roster
from offline.baselines.finding import Finding
from offline.evaluation_run import (
    choose_sets,
    evaluate_models,
    label_models,
    open_sets,
    run_evaluation,
)
from offline.predictor import BundlePredictor
from offline.provenance import describe_training
from offline.report_run import write_report
from offline.rivals import DEFAULT_RIVALS, SHIPPED, choose_rivals, known_rivals, open_rivals
from offline.robustness import ensure_robustness_data
from offline.test_sets import SET_NAMES
from rt_controller.contract.artifact import load_bundle, save_bundle
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.session import shipped_model

NO_RUN = Path("no/such/run")


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    """Rivals that need no fitting, and few other cars, in a cache of their own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    fitted = []

    def fit(name, dataset, cache_folder):
        fitted.append(name)
        return Hold()

    def report(name, dataset, cache_folder):
        return roster.Report(name, 0.5, (Finding("what it is", f"a stand-in for {name}"),))

    names = ("lti", "lti-per-curvature", "persistence", "gru")
    stand_in = SimpleNamespace(
        names=lambda: names,
        find_objection=roster.find_objection,
        fit=fit,
        report=report,
        fitted=fitted,
    )
    monkeypatch.setattr(rivals, "roster", stand_in)
    monkeypatch.setattr(
        evaluation_run, "ensure_robustness_data", lambda: ensure_robustness_data(episodes=3)
    )
    return stand_in


@pytest.fixture
def bundle_of(toy_dataset, tmp_path):
    """A bundle of the toy data in a folder of that name."""

    def write(name, **changes):
        shipped = load_bundle(shipped_model("lti"))
        bundle = replace(
            shipped,
            training=describe_training({}, toy_dataset.origin),
            data_sha256=toy_dataset.sha256,
            **changes,
        )
        save_bundle(tmp_path / name, bundle, "card")
        return tmp_path / name

    return write


@pytest.fixture
def shipped_met_the_toys(toy_dataset, monkeypatch):
    """The shipped network is of 7,000 episodes; here it would be judged on 40 of the same seed."""
    origin = replace(toy_dataset.origin, episodes=7_000)
    shipped = load_bundle(shipped_model(SHIPPED))
    shipped = replace(shipped, training=describe_training({}, origin))
    monkeypatch.setattr(rivals, "load_bundle", lambda folder: shipped)


def test_without_a_wish_the_plain_rivals_and_the_papers_network_are_taken():
    assert choose_rivals([]) == DEFAULT_RIVALS
    assert set(DEFAULT_RIVALS) <= set(known_rivals())
    assert choose_rivals(["none"]) == ()
    assert choose_rivals(["all"]) == ("lti", "lti-per-curvature", "persistence", "gru", SHIPPED)
    assert choose_rivals(["gru", "lti", "gru"]) == ("gru", "lti")


@pytest.mark.parametrize("asked", [["grue"], ["lti", "all"]])
def test_a_rival_that_nobody_knows_is_refused_with_those_that_are_known(asked):
    with pytest.raises(ConfigError, match="lti-per-curvature, persistence, gru"):
        choose_rivals(asked)


def test_the_library_is_always_judged_on():
    assert choose_sets([]) == SET_NAMES
    assert choose_sets(["robustness"]) == ("library", "robustness")
    assert choose_sets(["library"]) == ("library",)
    with pytest.raises(ConfigError, match="library, new-roads, robustness"):
        choose_sets(["holdout"])


def test_a_rival_that_may_have_met_the_test_episodes_is_left_out_or_refused(
    toy_dataset, capsys, quick, shipped_met_the_toys
):
    opened = open_rivals(DEFAULT_RIVALS, toy_dataset, [], insisted=False)
    assert list(opened) == ["lti", "lti-per-curvature", "persistence"]
    assert quick.fitted == list(opened)
    assert f"without {SHIPPED}" in capsys.readouterr().out
    quick.fitted.clear()
    with pytest.raises(DatasetError, match=SHIPPED):
        open_rivals(["lti", SHIPPED], toy_dataset, [], insisted=True)
    assert quick.fitted == []  # known before anything is fitted


def test_the_papers_network_is_no_rival_of_itself_and_one_of_others(
    toy_dataset, monkeypatch, bundle_of
):
    shipped = load_bundle(shipped_model(SHIPPED))
    shipped = replace(shipped, data_sha256=toy_dataset.sha256)
    monkeypatch.setattr(rivals, "load_bundle", lambda folder: shipped)
    other = load_bundle(bundle_of("other"))
    beside_other = open_rivals([SHIPPED], toy_dataset, [other], insisted=False)
    assert isinstance(beside_other[SHIPPED], BundlePredictor)
    assert open_rivals([SHIPPED], toy_dataset, [other, shipped], insisted=False) == {}


def test_all_rivals_are_those_that_can_be(toy_folder, bundle_of, shipped_met_the_toys):
    """Whoever asks for all of them insists on none."""
    model = bundle_of("model")
    evaluation = run_evaluation([model], toy_folder, NO_RUN, ["all"], ["library"])
    assert evaluation.judgement.rivals == ("lti", "lti-per-curvature", "persistence", "gru")


def test_data_without_roads_have_no_rival_for_each_road(toy_dataset, capsys):
    data = replace(toy_dataset, manifest=replace(toy_dataset.manifest, roads=None))
    assert list(open_rivals(["lti-per-curvature", "lti"], data, [], insisted=False)) == ["lti"]
    assert "know no roads" in capsys.readouterr().out


def test_other_cars_are_not_judged_on_by_a_model_that_learned_from_them(
    toy_dataset, bundle_of, capsys
):
    others = ensure_robustness_data(episodes=3)
    learned = replace(
        load_bundle(bundle_of("a")),
        training=describe_training({}, replace(others.origin, episodes=50)),
    )
    tests = open_sets(SET_NAMES, toy_dataset, [learned])
    assert [test.name for test in tests] == ["library", "new-roads"]
    assert "without robustness" in capsys.readouterr().out


def test_models_go_by_their_folder_and_runs_by_the_run(tmp_path):
    folders = [tmp_path / "runs/a/bundle", tmp_path / "runs/b/bundle", tmp_path / "lti"]
    assert label_models(folders) == ("a", "b", "lti")
    twins = [tmp_path / "x/net", tmp_path / "y/net"]
    assert label_models(twins) == ("x/net", "y/net")
    assert label_models([tmp_path / "x/lti"], taken=["lti"]) == ("x/lti",)
    with pytest.raises(ConfigError, match="twice"):
        label_models([tmp_path / "a", tmp_path / "a"])


def test_the_command_judges_several_models_on_every_set(
    bundle_of, toy_folder, tmp_path, capsys, quick
):
    models = [bundle_of("good"), bundle_of("bad", c=load_bundle(shipped_model("lti")).c + 0.01)]
    rivals = ["persistence", "lti"]
    json_file = tmp_path / "table.json"
    assert evaluate_models(models, toy_folder, NO_RUN, rivals, [], json_file) == 0
    figures = json.loads(json_file.read_text())
    assert figures["judged"] == ["good", "bad"]
    assert figures["rivals"] == rivals
    assert figures["data_sha256"]
    assert figures["model_sha256"]["good"] != figures["model_sha256"]["bad"]
    assert set(figures["sets"]) == set(SET_NAMES)
    errors = {
        name: model["mse"]["ey_m_squared"]["value"]
        for name, model in figures["sets"]["library"]["models"].items()
    }
    assert errors["good"] < errors["bad"]
    assert errors["persistence"] == errors["lti"]
    printed = capsys.readouterr().out
    assert "good" in printed
    assert "fair lti" in printed


def test_the_report_is_a_page_of_the_same_evaluation(bundle_of, toy_folder, tmp_path):
    output = tmp_path / "report.html"
    json_file = tmp_path / "report.json"
    models = [bundle_of("good")]
    assert write_report(output, models, toy_folder, NO_RUN, ["lti"], ["library"], json_file) == 0
    assert json.loads(json_file.read_text())["judged"] == ["good"]
    html = output.read_text()
    assert load_bundle(tmp_path / "good").sha256 in html
    assert "Double lane change" in html
    assert "a stand-in for lti" in html
