"""The trajectories that models are evaluated on."""

from dataclasses import replace

import numpy as np
import pytest

from offline.data.manifest import Roads
from offline.data.recording import Starts
from offline.evaluation import test_sets
from offline.evaluation.test_sets import choose_sets, library_set, new_roads_set
from rt_controller.contract.errors import ConfigError, DatasetError


@pytest.fixture
def toy_dataset(toy_dataset):
    """Half of the episodes held out, so that every road is among them."""
    part = np.where(np.arange(len(toy_dataset.part)) % 2, 2, 0).astype(np.int8)
    return replace(toy_dataset, part=part)


@pytest.fixture
def without_roads(toy_dataset):
    """The toy data as from a log: states on the driven road, no poses."""
    recording = toy_dataset.recording
    x = np.concatenate([recording.x, recording.x], axis=1)
    recording = recording._replace(x=x, pose=np.zeros((0, 3)))
    slices = Starts(toy_dataset.slices.row, toy_dataset.slices.episode, None)
    manifest = replace(toy_dataset.manifest, roads=None)
    return replace(toy_dataset, recording=recording, slices=slices, manifest=manifest)


def test_the_library_has_test_episodes_only(toy_dataset):
    found = library_set(toy_dataset)
    assert set(found.trajectories.episode) == set(toy_dataset.episodes("test"))
    assert found.curvatures_per_m == (-4e-3, 0.0, 4e-3)
    assert np.allclose(found.trajectories.w[:, 0, 0], found.curvature_per_m)


def test_the_library_has_at_most_the_given_number_of_each_curvature(toy_dataset):
    everything, few = library_set(toy_dataset), library_set(toy_dataset, per_curvature=3)
    assert {3} == set(np.unique(few.curvature_per_m, return_counts=True)[1])
    first = np.flatnonzero(everything.curvature_per_m == 0.0)[:3]
    chosen = few.curvature_per_m == 0.0
    assert np.array_equal(everything.trajectories.x[first], few.trajectories.x[chosen])


def test_five_curvatures_give_the_papers_2400_trajectories():
    assert test_sets.TRAJECTORIES_PER_CURVATURE * 5 == 2_400


def test_new_roads_have_the_same_drives(toy_dataset):
    """Motion and inputs are equal on all roads."""
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


def test_heading_error_on_a_new_road_is_yaw_minus_curvature_times_progress(toy_dataset):
    library, new = library_set(toy_dataset), new_roads_set(toy_dataset)

    def turned(found):
        x = found.trajectories.x.astype(float)
        curvature = found.curvature_per_m[:, None]
        return np.diff(x[..., 5], axis=1) + curvature * x[:, 1:, 3]

    n = library.n_trajectories
    assert np.ptp(library.trajectories.x[..., 5]) > 0.1
    for road in range(3):
        on_it = turned(new)[road * n : (road + 1) * n]
        assert np.allclose(on_it, turned(library), atol=2e-6)


def test_curvatures_of_the_library_are_not_among_the_new_ones(toy_dataset):
    roads = Roads((-1e-3, 0.0, 1e-3), 2.0, 0.15)
    manifest = replace(toy_dataset.manifest, roads=roads)
    assert new_roads_set(replace(toy_dataset, manifest=manifest)).curvatures_per_m == (3e-3,)
    every = replace(toy_dataset.manifest, roads=Roads((-1e-3, 1e-3, 3e-3), 2.0, 0.15))
    assert new_roads_set(replace(toy_dataset, manifest=every)) is None


def test_data_without_roads_have_a_library_and_no_new_roads(without_roads):
    library = library_set(without_roads)
    assert library.curvatures_per_m == ()
    assert library.n_trajectories == 5 * len(without_roads.episodes("test"))
    assert new_roads_set(without_roads) is None


def test_data_without_a_test_part_are_refused(toy_dataset):
    learned = replace(toy_dataset, part=np.zeros_like(toy_dataset.part))
    with pytest.raises(DatasetError, match="test trajectories"):
        library_set(learned)


def test_the_library_is_part_of_every_choice_of_sets():
    assert choose_sets([]) == test_sets.SET_NAMES
    assert choose_sets(["robustness"]) == ("library", "robustness")
    assert choose_sets(["library"]) == ("library",)
    with pytest.raises(ConfigError, match="library, new-roads, robustness, varied, noise"):
        choose_sets(["holdout"])
