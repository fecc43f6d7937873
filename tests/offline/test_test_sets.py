"""The trajectories that models are judged on."""

from dataclasses import replace

import numpy as np
import pytest

from offline import robustness, test_sets
from offline.config import PRESETS
from offline.manifest import Roads
from offline.recording import Starts
from offline.test_sets import library_set, new_roads_set, robustness_set
from rt_controller.contract.errors import DatasetError


@pytest.fixture
def toy_dataset(toy_dataset):
    """Half of the episodes held out, so that every road is among them."""
    part = np.where(np.arange(len(toy_dataset.part)) % 2, 2, 0).astype(np.int8)
    return replace(toy_dataset, part=part)


@pytest.fixture
def without_roads(toy_dataset):
    """The toy as a log would be: states on the road that was driven, no poses."""
    recording = toy_dataset.recording
    x = np.concatenate([recording.x, recording.x], axis=1)
    recording = recording._replace(x=x, pose=np.zeros((0, 3)))
    slices = Starts(toy_dataset.slices.row, toy_dataset.slices.episode, None)
    manifest = replace(toy_dataset.manifest, roads=None)
    return replace(toy_dataset, recording=recording, slices=slices, manifest=manifest)


def test_the_library_is_judged_on_test_episodes_only(toy_dataset):
    judged = library_set(toy_dataset)
    assert set(judged.trajectories.episode) == set(toy_dataset.episodes("test"))
    assert judged.curvatures_per_m == (-4e-3, 0.0, 4e-3)
    assert np.allclose(judged.trajectories.w[:, 0, 0], judged.curvature_per_m)


def test_at_most_so_many_trajectories_of_each_curvature_are_judged(toy_dataset):
    everything, few = library_set(toy_dataset), library_set(toy_dataset, per_curvature=3)
    assert {3} == set(np.unique(few.curvature_per_m, return_counts=True)[1])
    first = np.flatnonzero(everything.curvature_per_m == 0.0)[:3]
    chosen = few.curvature_per_m == 0.0
    assert np.array_equal(everything.trajectories.x[first], few.trajectories.x[chosen])


def test_the_papers_2400_are_480_of_each_of_five_curvatures():
    assert test_sets.TRAJECTORIES_PER_CURVATURE * 5 == 2_400


def test_new_roads_carry_the_same_drives(toy_dataset):
    """What the car did, and what was done to it, is the same on all of them."""
    library, new = library_set(toy_dataset), new_roads_set(toy_dataset)
    n = library.n_trajectories
    assert new.curvatures_per_m == (-1e-3, 1e-3, 3e-3)
    assert new.n_trajectories == 3 * n
    assert new.n_episodes == library.n_episodes
    for road in range(3):
        laid = new.trajectories.take(slice(road * n, (road + 1) * n))
        assert np.array_equal(laid.x[..., :3], library.trajectories.x[..., :3])
        for name in ("u", "past", "episode"):
            assert np.array_equal(getattr(laid, name), getattr(library.trajectories, name))
        assert np.all(laid.w == np.float32((-1e-3, 1e-3, 3e-3)[road]))


def test_on_a_new_road_the_heading_error_grows_by_what_the_road_turns_less(toy_dataset):
    """e_psi turns with the car and against the road: kappa times the progress."""
    library, new = library_set(toy_dataset), new_roads_set(toy_dataset)

    def turned(judged):
        x = judged.trajectories.x.astype(float)
        curvature = judged.curvature_per_m[:, None]
        return np.diff(x[..., 5], axis=1) + curvature * x[:, 1:, 3]

    n = library.n_trajectories
    assert np.ptp(library.trajectories.x[..., 5]) > 0.1
    for road in range(3):
        on_it = turned(new)[road * n : (road + 1) * n]
        assert np.allclose(on_it, turned(library), atol=2e-6)


def test_a_road_of_the_library_is_not_new(toy_dataset):
    roads = Roads((-1e-3, 0.0, 1e-3), 2.0, 0.15)
    manifest = replace(toy_dataset.manifest, roads=roads)
    assert new_roads_set(replace(toy_dataset, manifest=manifest)).curvatures_per_m == (3e-3,)
    every = replace(toy_dataset.manifest, roads=Roads((-1e-3, 1e-3, 3e-3), 2.0, 0.15))
    assert new_roads_set(replace(toy_dataset, manifest=every)) is None


def test_data_that_know_no_roads_are_judged_as_they_are(without_roads):
    library = library_set(without_roads)
    assert library.curvatures_per_m == ()
    assert library.n_trajectories == 5 * len(without_roads.episodes("test"))
    assert new_roads_set(without_roads) is None


def test_data_without_a_test_part_are_refused(toy_dataset):
    learned = replace(toy_dataset, part=np.zeros_like(toy_dataset.part))
    with pytest.raises(DatasetError, match="test trajectories"):
        library_set(learned)


@pytest.fixture
def others(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return robustness.ensure_robustness_data(episodes=3)


def test_robustness_is_judged_on_all_drives_of_other_cars_and_made_once(others, monkeypatch):
    judged = robustness_set(others)
    assert judged.n_trajectories == 15
    assert judged.n_episodes == 3
    assert "road friction 0.5 to 1" in judged.words
    assert "mass times 0.85 to 1.15" in judged.words
    monkeypatch.setattr(robustness, "generate", None)
    assert robustness.ensure_robustness_data(episodes=3).sha256 == others.sha256


def test_nobody_learns_from_the_seed_of_the_robustness_data():
    assert robustness.SEED not in {preset.data_seed for preset in PRESETS.values()}
    assert 5 * robustness.EPISODES == 480
