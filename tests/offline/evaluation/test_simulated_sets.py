"""Test sets of simulated drives beyond the recipe of the training data."""

from dataclasses import replace

import numpy as np
import pytest

from offline.config import PRESETS
from offline.evaluation import simulated_sets
from offline.evaluation.simulated_sets import (
    BY_FRICTION,
    BY_MASS_FACTOR,
    NOMINAL,
    SIMULATED,
    open_simulated_set,
)
from offline.evaluation.test_sets import ROBUSTNESS, SET_NAMES

BY_NAME = {each.name: each for each in SIMULATED}


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_the_data_are_made_once_and_used_whole(monkeypatch):
    few = replace(BY_NAME[ROBUSTNESS], episodes=3)
    dataset, test = open_simulated_set(few)
    assert (test.n_trajectories, test.n_episodes) == (15, 3)
    assert "road friction 0.5 to 1, mass times 0.85 to 1.15" in test.description
    monkeypatch.setattr(simulated_sets, "make_dataset", None)
    assert open_simulated_set(few)[0].sha256 == dataset.sha256


def test_no_preset_trains_with_the_seeds_of_these_sets():
    trained = {preset.data_seed for preset in PRESETS.values()}
    assert trained.isdisjoint(each.seed for each in SIMULATED)


def test_every_set_has_a_name_of_its_own_and_belongs_to_an_option():
    assert len(BY_NAME) == len(SIMULATED)
    for each in SIMULATED:
        assert set(each.options) <= set(SET_NAMES)
    assert {*BY_FRICTION.values(), *BY_MASS_FACTOR.values()} <= set(SIMULATED)


def test_the_same_drivers_drive_on_every_friction_and_with_every_mass():
    nominal = open_simulated_set(replace(NOMINAL, episodes=2))[1].trajectories
    for which in (BY_FRICTION[1.0], BY_MASS_FACTOR[1.15]):
        other = open_simulated_set(replace(which, episodes=2))[1].trajectories
        assert np.array_equal(other.u, nominal.u)
        assert not np.allclose(other.x[:, -1, :3], nominal.x[:, -1, :3], atol=1e-3)
