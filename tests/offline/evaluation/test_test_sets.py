"""The trajectories that models are evaluated on."""

from dataclasses import replace

import numpy as np
import pytest
from toy_predictors import made_test_set, made_trajectories

from offline.data.manifest import Roads
from offline.data.recording import Starts
from offline.data.signals import STANDARD_DEVIATIONS, VEHICLE_ROLES, Roles, past_names
from offline.evaluation import test_sets
from offline.evaluation.test_sets import (
    DEFAULT_LEVELS,
    choose_levels,
    choose_sets,
    library_set,
    new_roads_set,
    noisy_set,
)
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE, Schema, Signal


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


LIBRARY = made_test_set(made_trajectories(4_000))
HEARD = past_names(VEHICLE, VEHICLE_ROLES)


def differences(level):
    """What the noise adds to the first states (N, 6) and the past (N, H, 6)."""
    found = noisy_set(LIBRARY, level, VEHICLE, VEHICLE_ROLES).trajectories
    clean = LIBRARY.trajectories
    return (found.x - clean.x)[:, 0].astype(float), (found.past - clean.past).astype(float)


def test_only_the_first_state_and_the_past_have_noise():
    found, clean = noisy_set(LIBRARY, 1.0, VEHICLE, VEHICLE_ROLES), LIBRARY
    assert found.name == "noise-1"
    assert np.array_equal(found.trajectories.x[:, 1:], clean.trajectories.x[:, 1:])
    is_equal = found.trajectories.x[:, 0] == clean.trajectories.x[:, 0]
    assert is_equal.mean() < 0.01  # a small draw may be lost in single precision
    for name in ("u", "w", "episode"):
        assert np.array_equal(getattr(found.trajectories, name), getattr(clean.trajectories, name))


def test_the_noise_has_the_stated_standard_deviations():
    at_start, before = differences(1.0)
    for name, expected in STANDARD_DEVIATIONS.items():
        column = VEHICLE.state_names.index(name)
        assert at_start[:, column].std() == pytest.approx(expected, rel=0.05)
        assert abs(at_start[:, column].mean()) < 0.1 * expected
        if name in HEARD:
            assert before[..., HEARD.index(name)].std() == pytest.approx(expected, rel=0.02)


def test_inputs_of_the_past_have_no_noise():
    _, before = differences(3.0)
    for name in set(HEARD) & set(VEHICLE.input_names):
        assert np.all(before[..., HEARD.index(name)] == 0.0)


def test_progress_is_that_of_the_noisy_speed():
    at_start, _ = differences(1.0)
    speed, progress = (VEHICLE.state_names.index(name) for name in ("vx_mps", "ds_m"))
    assert np.allclose(at_start[:, progress], VEHICLE.dt_s * at_start[:, speed], atol=1e-6)


def test_instants_have_independent_noise():
    at_start, before = differences(1.0)
    now, last = at_start[:, 0], before[:, -1, HEARD.index("vx_mps")]
    assert abs(np.corrcoef(now, last)[0, 1]) < 0.06


def test_every_call_draws_the_same_noise_and_a_level_scales_it():
    once, again, thrice = differences(1.0), differences(1.0), differences(3.0)
    assert np.array_equal(once[0], again[0])
    assert np.array_equal(once[1], again[1])
    assert np.allclose(thrice[0], 3.0 * once[0], atol=1e-6)
    assert np.allclose(thrice[1], 3.0 * once[1], atol=1e-6)


def test_states_of_unknown_noise_have_no_noisy_set():
    schema = Schema((Signal("heat_k", "K"),), (), (), 0.1)
    test = made_test_set(made_trajectories(5, states=1))
    assert noisy_set(test, 1.0, schema, Roles((), None, ())) is None


def test_levels_are_sorted_and_each_is_used_once():
    assert choose_levels([3.0, 0.5, 3.0]) == (0.5, 3.0)
    assert choose_levels(None) == choose_levels([]) == DEFAULT_LEVELS


@pytest.mark.parametrize("level", [0.0, -1.0, 1e3, float("nan"), float("inf")])
def test_a_level_without_a_meaning_is_refused(level):
    with pytest.raises(ConfigError, match="--noise"):
        choose_levels([1.0, level])
