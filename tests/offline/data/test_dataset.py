"""Data sets on disk: written, loaded, and refused if damaged."""

import json
from dataclasses import replace

import numpy as np
import pytest
from dataset_numbers import same_numbers

from offline.config import PAST_STEPS, STEPS
from offline.data.dataset import cache, exists, load_dataset, save_dataset, split_episodes
from offline.data.generate import make_dataset, simulated_origin, steering_geometry
from offline.data.manifest import (
    MANIFEST_FILE,
    PARTS,
    Imported,
    Simulated,
    SourceFile,
    read_manifest,
)
from offline.data.recipe import Recipe
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.data.variation import VARIED
from rt_controller.contract.car import Car
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.contract.signals import VEHICLE


def save_again(folder, dataset, **changes):
    """Save the data set in another folder with some parts replaced."""
    parts = {
        "recording": dataset.recording,
        "slices": dataset.slices,
        "part": dataset.part,
        "roads": dataset.manifest.roads,
        "origin": dataset.origin,
        **changes,
    }
    return save_dataset(folder, schema=dataset.schema, roles=dataset.roles, **parts)


def test_a_saved_data_set_is_loaded_unchanged(toy_dataset, tmp_path):
    saved = save_again(tmp_path, toy_dataset)
    loaded = load_dataset(tmp_path)
    assert same_numbers(loaded, saved)
    assert loaded.manifest == saved.manifest
    assert loaded.sha256 == toy_dataset.sha256


def test_a_loaded_data_set_has_its_schema_roles_and_origin(toy_dataset):
    assert toy_dataset.schema == VEHICLE
    assert toy_dataset.roles == VEHICLE_ROLES
    assert toy_dataset.manifest.roads.ey_m == 2.0
    assert toy_dataset.manifest.trajectories == 200
    assert toy_dataset.manifest.rejected_fraction == pytest.approx(0.2)
    assert toy_dataset.origin.recipe.brakes_n[-1] == 150.0


def test_the_manifest_contains_names_units_and_origin(toy_folder):
    fields = json.loads((toy_folder / MANIFEST_FILE).read_text())
    assert [unit for _, unit in fields["schema"]["states"]] == [
        *("m/s", "m/s", "rad/s", "m", "m", "rad")
    ]
    assert fields["roles"]["centred"] == ["vx_mps", "ds_m"]
    origin = fields["origin"]
    assert (origin["episodes"], origin["seed"], origin["plant_fingerprint"]) == (40, 3, "toy")
    assert origin["recipe"]["brakes_n"][-1] == 150.0
    assert fields["rejected_episodes"] == 10


def test_reading_and_writing_a_manifest_does_not_change_it(toy_folder):
    path = toy_folder / MANIFEST_FILE
    assert read_manifest(path).to_json() == path.read_text()


def test_the_manifest_of_imported_logs_contains_their_names_and_the_mapping(toy_dataset, tmp_path):
    logs = (SourceFile("monday.csv", "ab" * 32), SourceFile("tuesday.csv", "cd" * 32))
    origin = Imported(logs, mapping='[states]\nspeed = "v"\n', episodes=40, seed=3)
    save_again(tmp_path, toy_dataset, origin=origin)
    assert load_dataset(tmp_path).origin == origin


def test_the_car_is_kept_with_its_own_values_and_may_be_missing(toy_dataset, tmp_path):
    assert toy_dataset.car is None
    car = Car(steering_geometry(), plan_lateral_mps2=3.0, thresholds={"yaw_rate_ten_radps": 0.1})
    save_again(tmp_path, toy_dataset, car=car)
    loaded = load_dataset(tmp_path)
    assert loaded.car == car
    save_again(tmp_path / "default", toy_dataset, car=Car(steering_geometry()))
    assert load_dataset(tmp_path / "default").car == Car()
    assert '"car"' not in (tmp_path / "default" / MANIFEST_FILE).read_text()
    assert steering_geometry() == DEFAULT_GEOMETRY
    assert loaded.sha256 == toy_dataset.sha256


def with_conditions(dataset):
    """Row t holds the friction t and the bank -t."""
    t = np.arange(len(dataset.recording.x), dtype=np.float32)
    return {
        "recording": dataset.recording._replace(conditions=np.column_stack([t, -t])),
        "conditions": ("friction_left", "bank_rad"),
    }


def test_conditions_are_kept_with_their_names_and_change_the_hash(toy_dataset, tmp_path):
    saved = save_again(tmp_path, toy_dataset, **with_conditions(toy_dataset))
    loaded = load_dataset(tmp_path)
    assert same_numbers(loaded, saved)
    assert loaded.manifest == saved.manifest
    assert loaded.manifest.conditions == ("friction_left", "bank_rad")
    assert loaded.sha256 != toy_dataset.sha256
    assert loaded.conditions_at(np.array([[3, 5]])).tolist() == [[[3.0, -3.0], [5.0, -5.0]]]


def test_a_data_set_without_conditions_says_how_to_make_one_with(toy_dataset):
    assert toy_dataset.recording.conditions is None
    assert toy_dataset.select("test").conditions is None
    with pytest.raises(DatasetError, match="offline-data --recipe varied"):
        toy_dataset.conditions_at(np.arange(3))


@pytest.mark.parametrize("names", [(), ("friction_left",)])
def test_conditions_without_a_name_for_each_column_are_refused(toy_dataset, tmp_path, names):
    parts = {**with_conditions(toy_dataset), "conditions": names}
    with pytest.raises(DatasetError, match="conditions of shape"):
        save_again(tmp_path, toy_dataset, **parts)


def test_a_condition_that_is_not_finite_is_refused_with_its_name_and_episode(toy_dataset, tmp_path):
    parts = with_conditions(toy_dataset)
    parts["recording"].conditions[500, 1] = np.nan
    with pytest.raises(DatasetError, match="bank_rad at sample 79 of episode 1"):
        save_again(tmp_path, toy_dataset, **parts)


def test_no_episode_is_in_two_parts(toy_dataset):
    parts = [set(toy_dataset.select(part).episode.tolist()) for part in PARTS]
    assert [len(part) for part in parts] == [32, 4, 4]
    assert len(set.union(*parts)) == 40
    assert [set(toy_dataset.episodes(part).tolist()) for part in PARTS] == parts


def test_a_part_is_its_slices_in_stored_order_with_the_longest_past(toy_dataset):
    validation = toy_dataset.select("validation")
    assert validation.x.shape == (20, STEPS + 1, 6)
    assert validation.past.shape == (20, PAST_STEPS, 6)
    stored = cut(toy_dataset.recording, toy_dataset.slices, VEHICLE, VEHICLE_ROLES)
    chosen = np.isin(stored.episode, toy_dataset.episodes("validation"))
    for one, other in zip(validation, stored.take(chosen), strict=True):
        assert np.array_equal(one, other)


def test_slices_of_logs_without_poses_equal_the_recorded_states(toy_dataset, tmp_path):
    recording = toy_dataset.recording
    states = np.column_stack([recording.x, recording.x]).astype(np.float32)
    save_again(
        tmp_path,
        toy_dataset,
        recording=recording._replace(x=states, pose=np.zeros((0, 3))),
        slices=toy_dataset.slices._replace(anchor=None),
        roads=None,
    )
    logs = load_dataset(tmp_path)
    assert logs.slices.anchor is None
    first = logs.slices.row[0]
    chosen = logs.part[0]
    found = logs.select(PARTS[chosen])
    place = found.episode.tolist().index(0)
    assert np.array_equal(found.x[place], states[first : first + STEPS + 1])


def test_split_depends_on_the_seed_and_on_the_number_of_episodes():
    split = split_episodes(50, 1)
    assert np.array_equal(split_episodes(50, 1), split)
    assert not np.array_equal(split_episodes(50, 2), split)
    assert not np.array_equal(split_episodes(60, 1)[:50], split)


@pytest.mark.parametrize("episodes", [10, 50, 7000])
def test_a_tenth_of_the_episodes_is_held_back_for_each_of_validation_and_test(episodes):
    counts = np.bincount(split_episodes(episodes, 0))
    assert counts.tolist() == [episodes - 2 * (episodes // 10), episodes // 10, episodes // 10]


@pytest.mark.parametrize("episodes", [3, 4, 5, 7])
def test_a_few_episodes_suffice_for_three_parts(episodes):
    """Without a validation part no model can be selected."""
    assert np.bincount(split_episodes(episodes, 0), minlength=3).min() >= 1


def test_the_name_of_a_cache_folder_depends_on_recipe_length_seed_and_car(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert tmp_path in cache().parents
    first = Simulated(Recipe(), 100, 0, "car")
    others = [
        replace(first, recipe=Recipe(segment_s=(1.0,))),
        replace(first, recipe=Recipe(variation=VARIED)),
        replace(first, recipe=Recipe(largest_steer_deg=40.0)),
        replace(first, episodes=101),
        replace(first, seed=1),
        replace(first, plant_fingerprint="another car"),
    ]
    assert len({first.name, *(other.name for other in others)}) == 7
    assert first.name == Simulated(Recipe(), 100, 0, "car").name


def test_the_names_of_cached_data_sets_do_not_change():
    """With another name, existing data sets would not be found."""
    assert Simulated(Recipe(), 7000, 0, "car").name == "7000-episodes-740dc0754217bc12"


@pytest.mark.parametrize(
    ("series", "column", "name"),
    [
        ("x", 2, "yaw_rate_radps"),
        ("u", 1, "brake_n"),
        ("w", 0, "curvature"),
        ("pose", 2, "yaw_rad"),
    ],
)
def test_a_number_that_is_not_finite_is_refused_with_its_signal_and_place(
    toy_dataset, tmp_path, series, column, name
):
    recording = toy_dataset.recording
    array = getattr(recording, series).copy()
    array[recording.first[7] + 5, column] = np.nan
    damaged = recording._replace(**{series: array})
    with pytest.raises(DatasetError, match=rf"found nan for {name}.* at sample 5 of episode 7"):
        save_again(tmp_path, toy_dataset, recording=damaged)
    assert not exists(tmp_path)


def test_a_road_that_is_not_finite_is_refused(toy_dataset, tmp_path):
    anchor = toy_dataset.slices.anchor
    ey_m = anchor.ey_m.copy()
    ey_m[3] = np.inf
    slices = toy_dataset.slices._replace(anchor=anchor._replace(ey_m=ey_m))
    with pytest.raises(DatasetError, match="ey_m"):
        save_again(tmp_path, toy_dataset, slices=slices)


@pytest.mark.parametrize("roads", ["missing", "superfluous"])
def test_poses_and_roads_belong_together(toy_dataset, tmp_path, roads):
    if roads == "missing":
        changes = {"roads": None}
    else:
        no_pose = toy_dataset.recording._replace(pose=np.zeros((0, 3)))
        changes = {"recording": no_pose, "slices": toy_dataset.slices._replace(anchor=None)}
    with pytest.raises(DatasetError, match=r"poses: (True|False), slices on roads"):
        save_again(tmp_path, toy_dataset, **changes)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match="expected a folder with room for a data set"):
        make_dataset(tmp_path / "file" / "data", simulated_origin(Recipe(), 10**9, 0))
