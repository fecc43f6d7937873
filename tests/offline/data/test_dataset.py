"""Data sets in their folders: what is written is read, and nothing else is."""

import json
import random
import shutil
from dataclasses import replace

import numpy as np
import pytest

from offline.config import PAST_STEPS, STEPS
from offline.data.dataset import (
    cache,
    cache_folder,
    exists,
    load_dataset,
    save_dataset,
    split_episodes,
)
from offline.data.generate import make_dataset, simulated_origin, steering_geometry
from offline.data.manifest import (
    MANIFEST_FILE,
    PARTS,
    RECORDING_FILE,
    read_manifest,
)
from offline.data.recipe import Recipe
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.data.variation import VARIED
from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.contract.signals import VEHICLE


def numbers_of(dataset):
    recorded = [array for array in dataset.recording if array is not None]
    return [*recorded, dataset.part, *dataset.slices[:2], *(dataset.slices.anchor or ())]


def same_numbers(one, other) -> bool:
    pairs = zip(numbers_of(one), numbers_of(other), strict=True)
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs)


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


def with_conditions(dataset):
    """Row t holds the friction t and the bank -t."""
    t = np.arange(len(dataset.recording.x), dtype=np.float32)
    return {
        "recording": dataset.recording._replace(conditions=np.column_stack([t, -t])),
        "conditions": ("friction_left", "bank_rad"),
    }


def test_the_manifest_contains_names_units_and_origin(toy_folder, toy_dataset):
    path = toy_folder / MANIFEST_FILE
    assert read_manifest(path).to_json() == path.read_text()
    fields = json.loads(path.read_text())
    assert [unit for _, unit in fields["schema"]["states"]] == [
        *("m/s", "m/s", "rad/s", "m", "m", "rad")
    ]
    assert fields["roles"]["centred"] == ["vx_mps", "ds_m"]
    origin = fields["origin"]
    assert (origin["episodes"], origin["seed"], origin["plant_fingerprint"]) == (40, 3, "toy")
    assert origin["recipe"]["brakes_n"][-1] == 150.0
    assert fields["rejected_episodes"] == 10
    assert toy_dataset.manifest.rejected_fraction == pytest.approx(0.2)


def test_the_car_is_kept_with_its_own_values_and_may_be_missing(toy_dataset, tmp_path):
    assert toy_dataset.car is None
    car = Car(*steering_geometry(), plan_lateral_mps2=3.0, thresholds={"yaw_rate_ten_radps": 0.1})
    save_again(tmp_path, toy_dataset, car=car)
    assert load_dataset(tmp_path).car == car
    save_again(tmp_path / "default", toy_dataset, car=Car(*steering_geometry()))
    assert load_dataset(tmp_path / "default").car == DEFAULT_CAR
    assert steering_geometry() == DEFAULT_GEOMETRY


def test_conditions_are_kept_with_their_names_and_change_the_hash(toy_dataset, tmp_path):
    saved = save_again(tmp_path, toy_dataset, **with_conditions(toy_dataset))
    loaded = load_dataset(tmp_path)
    assert same_numbers(loaded, saved)
    assert loaded.manifest == saved.manifest
    assert loaded.sha256 != toy_dataset.sha256


def with_nan(dataset, series, column):
    """A recording with nan at sample 5 of episode 7."""
    array = getattr(dataset.recording, series).copy()
    array[dataset.recording.first[7] + 5, column] = np.nan
    return {"recording": dataset.recording._replace(**{series: array})}


def with_nan_condition(dataset):
    parts = with_conditions(dataset)
    parts["recording"].conditions[500, 1] = np.nan
    return parts


def with_infinite_road(dataset):
    anchor = dataset.slices.anchor
    return {"slices": dataset.slices._replace(anchor=anchor._replace(ey_m=anchor.ey_m * np.inf))}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (lambda data: with_nan(data, "x", 2), "found nan in row 2952 of x"),
        (lambda data: with_nan(data, "pose", 2), "found nan in row 2952 of pose"),
        (with_nan_condition, "row 500 of conditions"),
        (with_infinite_road, "slice_ey_m"),
    ],
)
def test_numbers_that_no_model_may_learn_from_are_not_saved(toy_dataset, tmp_path, changes, words):
    with pytest.raises(DatasetError, match=words):
        save_again(tmp_path, toy_dataset, **changes(toy_dataset))
    assert not exists(tmp_path)


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


@pytest.mark.parametrize(("episodes", "held_back"), [(3, 1), (7, 1), (50, 5), (7000, 700)])
def test_a_tenth_of_the_episodes_and_at_least_one_is_held_back_for_each_part(episodes, held_back):
    split = split_episodes(episodes, 1)
    assert np.bincount(split).tolist() == [episodes - 2 * held_back, held_back, held_back]
    assert np.array_equal(split_episodes(episodes, 1), split)
    assert episodes < 50 or not np.array_equal(split_episodes(episodes, 2), split)


def test_a_data_set_of_the_cache_is_found_by_recipe_length_seed_and_car(
    monkeypatch, tmp_path, toy_folder
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    shutil.copytree(toy_folder, cache() / "of any name")
    (cache() / "damaged").mkdir()
    (cache() / "damaged" / MANIFEST_FILE).write_text("{")
    found = read_manifest(toy_folder / MANIFEST_FILE).origin
    others = [
        replace(found, recipe=Recipe(segment_s=(1.0,))),
        replace(found, recipe=Recipe(variation=VARIED)),
        replace(found, recipe=Recipe(variation=VARIED.model_copy(update={"gust_mps": 4.0}))),
        replace(found, recipe=Recipe(largest_steer_deg=40.0)),
        replace(found, episodes=101),
        replace(found, seed=1),
        replace(found, plant_fingerprint="another car"),
    ]
    assert cache_folder(found) == cache() / "of any name"
    assert {cache_folder(other) for other in others} == {cache() / each.name for each in others}
    assert len({each.name for each in (found, *others)}) == 8


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match="expected a folder with room for a data set"):
        make_dataset(tmp_path / "file" / "data", simulated_origin(Recipe(), 10**9, 0))


@pytest.fixture
def folder(toy_folder, tmp_path):
    return shutil.copytree(toy_folder, tmp_path / "data")


def in_manifest(*place):
    """An edit that sets the last of `place` in the manifest."""
    *outer, key, value = place

    def edit(folder):
        path = folder / MANIFEST_FILE
        fields = json.loads(path.read_text())
        inner = fields
        for name in outer:
            inner = inner[name]
        inner[key] = value
        path.write_text(json.dumps(fields))

    return edit


def in_arrays(name, value):
    def edit(folder):
        arrays = dict(np.load(folder / RECORDING_FILE))
        if value is None:
            arrays.pop(name)
        else:
            arrays[name].flat[0] = value
        np.savez(folder / RECORDING_FILE, **arrays)

    return edit


def truncated(keep, name=RECORDING_FILE):
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:keep])


def without(name):
    return lambda folder: (folder / name).unlink()


REMEDY = "Delete the folder and make the data set again with offline-data or offline-import"
DAMAGES = [
    (without(MANIFEST_FILE), "offline-data"),
    (without(RECORDING_FILE), RECORDING_FILE),
    (truncated(0), "truncated or foreign"),
    (truncated(5000), "truncated or foreign"),
    (truncated(0, MANIFEST_FILE), "expected a"),
    (lambda folder: (folder / MANIFEST_FILE).write_text("[1, 2]"), "expected a"),
    (in_arrays("w", None), "expected the arrays x, u, w, pose"),
    *((in_arrays(name, 99), "SHA-256") for name in ("x", "slice_ey_m", "part")),
    # Roles and units change the training as numbers do.
    (in_manifest("roles", "odd", ["vy_mps"]), "SHA-256"),
    (in_manifest("roads", None), "SHA-256"),
    (in_manifest("schema", "states", 0, ["vx_mps", "km/h"]), "SHA-256"),
    (in_manifest("format_version", 1), rf"format_version = 2, found 1\. {REMEDY}"),
    (in_manifest("origin", "seed", "zero"), "seed"),
    (in_manifest("origin", "recipe", "segment_s", "short"), "segment_s"),
    (in_manifest("schema", "states", [["vx_mps"]]), "states"),
]


@pytest.mark.parametrize(("damage", "words"), DAMAGES)
def test_a_damaged_altered_or_foreign_data_set_is_refused(folder, damage, words):
    damage(folder)
    assert exists(folder) is (folder / MANIFEST_FILE).exists()
    with pytest.raises(DatasetError, match=words):
        load_dataset(folder)


def test_a_flipped_bit_is_detected_or_does_not_change_the_data(folder, toy_dataset):
    """Dates and other metadata of the archive do not matter."""
    path = folder / RECORDING_FILE
    whole = path.read_bytes()
    # Most bytes are numbers; the archive's directory is at the end.
    rng = random.Random(0)
    places = [rng.randrange(len(whole)) for _ in range(10)]
    places += [len(whole) - 1 - rng.randrange(1000) for _ in range(60)]
    refused = 0
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << rng.randrange(8)
        path.write_bytes(flipped)
        found = unless_refused(folder)
        refused += found is None
        assert found is None or same_numbers(found, toy_dataset)
    assert refused > 30


def unless_refused(folder):
    try:
        return load_dataset(folder)
    except DatasetError:
        return None
