"""A model is never judged on episodes that it may have been trained on."""

import json
from dataclasses import replace

import pytest

from offline import held_out
from offline.baselines.lti import fit_lti
from offline.dataset import cache, save_dataset
from offline.excitation import Recipe
from offline.export import choose_selftest_states
from offline.generate import generate
from offline.held_out import choose_test_set
from offline.manifest import Origin
from offline.provenance import is_held_out
from rt_controller.contract.errors import DatasetError

NO_RUN = "no/such/run"


@pytest.fixture
def stock(monkeypatch, tmp_path, toy_dataset):
    """Data sets in a cache of their own; the full one has 40 episodes of seed 3."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(held_out, "full_folder", lambda: cache() / "full")

    def put(name, episodes, seed=3):
        toy = toy_dataset.trajectories
        few = toy.take(toy.episode < episodes)
        origin = replace(toy_dataset.origin, episodes=episodes, seed=seed)
        return save_dataset(cache() / name, few, rejected=0, origin=origin)

    return put


def trained_on(dataset):
    return fit_lti(dataset, choose_selftest_states(dataset))


def test_smaller_data_sets_begin_with_the_same_episodes():
    """Why any of this is needed."""
    few, more = (generate(Recipe(), episodes, seed=5, jobs=1) for episodes in (2, 3))
    assert (few.trajectories.x == more.trajectories.x[:10]).all()


def test_a_model_of_the_full_data_set_is_judged_on_it(stock, tmp_path):
    full = stock("full", 40)
    assert choose_test_set(trained_on(full), None, tmp_path / NO_RUN).sha256 == full.sha256


def test_a_model_of_the_first_episodes_is_judged_on_its_own_test_part(stock, tmp_path, capsys):
    stock("full", 40)
    small = stock("small", 20)
    assert choose_test_set(trained_on(small), None, tmp_path / NO_RUN).sha256 == small.sha256
    assert "may have been trained on" in " ".join(capsys.readouterr().out.split())


def test_a_model_of_another_seed_is_judged_on_the_full_data_set(stock, tmp_path):
    full, other = stock("full", 40), stock("other", 20, seed=4)
    assert choose_test_set(trained_on(other), None, tmp_path / NO_RUN).sha256 == full.sha256


def test_naming_a_data_set_that_the_model_may_have_been_trained_on_is_refused(stock, tmp_path):
    stock("full", 40)
    small = stock("small", 20)
    with pytest.raises(DatasetError, match="trained on some of its test episodes") as error:
        choose_test_set(trained_on(small), cache() / "full", tmp_path / NO_RUN)
    assert "40 episodes of seed 3" in str(error.value)


def test_without_any_data_set_that_was_held_out_nothing_is_judged(stock, tmp_path):
    full, small = stock("full", 40), stock("small", 20)
    for file in (cache() / "small").iterdir():
        file.unlink()
    assert full.sha256 != small.sha256
    with pytest.raises(DatasetError, match="offline-data"):
        choose_test_set(trained_on(small), None, tmp_path / NO_RUN)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, True),
        ({"sha256": "other digits, from another processor"}, True),
        ({"sha256": "other", "seed": 4}, True),
        ({"sha256": "other", "seed": 4, "episodes": 50}, True),
        ({"sha256": "other", "episodes": 50}, False),
    ],
)
def test_same_seed_and_other_length_is_what_leaks(toy_dataset, changes, expected):
    manifest = toy_dataset.manifest
    origin = Origin(
        manifest.origin.recipe,
        changes.get("episodes", 40),
        changes.get("seed", 3),
        manifest.origin.plant_fingerprint,
    )
    other = replace(manifest, sha256=changes.get("sha256", manifest.sha256), origin=origin)
    assert is_held_out(trained_on(toy_dataset), other) is expected


@pytest.mark.parametrize("training", ["{}", "no JSON", "[]", json.dumps({"data_seed": None})])
def test_a_bundle_that_does_not_say_is_judged_on_its_own_data_only(toy_dataset, training):
    silent = replace(trained_on(toy_dataset), training=training)
    assert is_held_out(silent, toy_dataset.manifest)
    assert not is_held_out(silent, replace(toy_dataset.manifest, sha256="other"))
