"""What is on disk is what was made, or it is refused."""

import json
import random
import shutil
from dataclasses import replace

import numpy as np
import pytest

from offline.dataset import (
    MANIFEST_FILE,
    PARTS,
    RECORDING_FILE,
    cache,
    exists,
    load_dataset,
    save_dataset,
    split_episodes,
)
from offline.excitation import Recipe
from offline.lengths import PAST_STEPS, STEPS
from offline.manifest import Driven, Imported, SourceFile, read_manifest
from offline.recording import cut
from offline.roles import VEHICLE_ROLES
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import VEHICLE


@pytest.fixture
def folder(toy_folder, tmp_path):
    return shutil.copytree(toy_folder, tmp_path / "data")


def edit_manifest(folder, edit):
    path = folder / MANIFEST_FILE
    fields = json.loads(path.read_text())
    edit(fields)
    path.write_text(json.dumps(fields))


def edit_arrays(folder, edit):
    path = folder / RECORDING_FILE
    arrays = dict(np.load(path))
    edit(arrays)
    np.savez(path, **arrays)


def save_again(folder, dataset, **changes):
    """The data set in another folder, some of its parts replaced."""
    parts = {
        "recording": dataset.recording,
        "slices": dataset.slices,
        "part": dataset.part,
        "roads": dataset.manifest.roads,
        "origin": dataset.origin,
        **changes,
    }
    return save_dataset(folder, schema=dataset.schema, roles=dataset.roles, **parts)


def numbers_of(dataset):
    return [*dataset.recording, dataset.part, *dataset.slices[:2], *(dataset.slices.anchor or ())]


def same_numbers(one, other) -> bool:
    pairs = zip(numbers_of(one), numbers_of(other), strict=True)
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in pairs)


def test_a_saved_data_set_comes_back_number_by_number(toy_dataset, tmp_path):
    saved = save_again(tmp_path, toy_dataset)
    loaded = load_dataset(tmp_path)
    assert same_numbers(loaded, saved)
    assert loaded.manifest == saved.manifest
    assert loaded.sha256 == toy_dataset.sha256


def test_a_loaded_data_set_knows_its_signals_their_roles_and_its_origin(toy_dataset):
    assert toy_dataset.schema == VEHICLE
    assert toy_dataset.roles == VEHICLE_ROLES
    assert toy_dataset.manifest.roads.ey_m == 2.0
    assert toy_dataset.manifest.trajectories == 200
    assert toy_dataset.manifest.rejected_fraction == pytest.approx(0.2)
    assert toy_dataset.origin.recipe.brakes_n[-1] == 150.0


def test_the_manifest_says_names_units_and_origin_for_others_to_read(toy_folder):
    fields = json.loads((toy_folder / MANIFEST_FILE).read_text())
    assert [unit for _, unit in fields["schema"]["states"]] == [
        *("m/s", "m/s", "rad/s", "m", "m", "rad")
    ]
    assert fields["roles"]["centred"] == ["vx_mps", "ds_m"]
    origin = fields["origin"]
    assert (origin["episodes"], origin["seed"], origin["plant_fingerprint"]) == (40, 3, "toy")
    assert origin["recipe"]["brakes_n"][-1] == 150.0
    assert fields["rejected_episodes"] == 10


def test_a_manifest_that_was_read_is_written_the_same(toy_folder):
    path = toy_folder / MANIFEST_FILE
    assert read_manifest(path).to_json() == path.read_text()


def test_the_manifest_of_imported_logs_names_them_and_how_they_were_read(toy_dataset, tmp_path):
    logs = (SourceFile("monday.csv", "ab" * 32), SourceFile("tuesday.csv", "cd" * 32))
    origin = Imported(logs, mapping='[states]\nspeed = "v"\n', episodes=40, seed=3)
    save_again(tmp_path, toy_dataset, origin=origin)
    assert load_dataset(tmp_path).origin == origin


def test_no_episode_is_in_two_parts(toy_dataset):
    parts = [set(toy_dataset.select(part).episode.tolist()) for part in PARTS]
    assert [len(part) for part in parts] == [32, 4, 4]
    assert len(set.union(*parts)) == 40
    assert [set(toy_dataset.episodes(part).tolist()) for part in PARTS] == parts


def test_a_part_is_its_slices_in_stored_order_with_all_of_the_past(toy_dataset):
    validation = toy_dataset.select("validation")
    assert validation.x.shape == (20, STEPS + 1, 6)
    assert validation.past.shape == (20, PAST_STEPS, 6)
    stored = cut(toy_dataset.recording, toy_dataset.slices, VEHICLE, VEHICLE_ROLES)
    chosen = np.isin(stored.episode, toy_dataset.episodes("validation"))
    for one, other in zip(validation, stored.take(chosen), strict=True):
        assert np.array_equal(one, other)


def test_slices_of_logs_without_poses_come_as_they_were_recorded(toy_dataset, tmp_path):
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
def test_a_few_episodes_still_make_three_parts(episodes):
    """Logs of one day may be three drives; without a validation part no model can be chosen."""
    assert np.bincount(split_episodes(episodes, 0), minlength=3).min() >= 1


def test_cache_folder_is_named_after_everything_the_data_follow_from(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert tmp_path in cache().parents
    first = Driven(Recipe(), 100, 0, "car")
    others = [
        replace(first, recipe=Recipe(segment_s=(1.0,))),
        replace(first, recipe=Recipe(road_friction=(0.5, 1.0))),
        replace(first, episodes=101),
        replace(first, seed=1),
        replace(first, plant_fingerprint="another car"),
    ]
    assert len({first.name, *(other.name for other in others)}) == 6
    assert first.name == Driven(Recipe(), 100, 0, "car").name


def test_cached_data_sets_keep_their_names():
    """Another name would throw away what was made under this one."""
    assert Driven(Recipe(), 7000, 0, "car").name == "7000-episodes-fc662058657450be"


def test_a_folder_without_manifest_is_no_data_set(folder):
    assert exists(folder)
    (folder / MANIFEST_FILE).unlink()
    assert not exists(folder)
    with pytest.raises(DatasetError, match="offline-data"):
        load_dataset(folder)


@pytest.mark.parametrize("name", ["x", "pose", "slice_ey_m", "slice_row"])
def test_an_altered_number_is_noticed(folder, name):
    edit_arrays(folder, lambda arrays: arrays[name].__setitem__(arrays[name].ndim * (0,), 99))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


@pytest.mark.parametrize(
    ("series", "column", "name"),
    [
        ("x", 2, "yaw_rate_radps"),
        ("u", 1, "brake_n"),
        ("w", 0, "curvature"),
        ("pose", 2, "yaw_rad"),
    ],
)
def test_a_number_that_is_none_is_named_with_its_place(toy_dataset, tmp_path, series, column, name):
    recording = toy_dataset.recording
    array = getattr(recording, series).copy()
    array[recording.first[7] + 5, column] = np.nan
    damaged = recording._replace(**{series: array})
    with pytest.raises(DatasetError, match=rf"found nan for {name}.* at sample 5 of episode 7"):
        save_again(tmp_path, toy_dataset, recording=damaged)
    assert not exists(tmp_path)


def test_a_road_that_is_no_number_is_refused(toy_dataset, tmp_path):
    anchor = toy_dataset.slices.anchor
    ey_m = anchor.ey_m.copy()
    ey_m[3] = np.inf
    slices = toy_dataset.slices._replace(anchor=anchor._replace(ey_m=ey_m))
    with pytest.raises(DatasetError, match="ey_m"):
        save_again(tmp_path, toy_dataset, slices=slices)


def test_an_altered_split_is_noticed(folder):
    edit_arrays(folder, lambda arrays: arrays["part"].fill(0))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


@pytest.mark.parametrize("altered", ["role", "unit"])
def test_an_altered_meaning_of_the_numbers_is_noticed(folder, altered):
    """What a model learns follows from the roles and units as much as from the numbers."""
    path = folder / MANIFEST_FILE
    fields = json.loads(path.read_text())
    if altered == "role":
        fields["roles"]["odd"] = fields["roles"]["odd"][:-1]
    else:
        fields["schema"]["states"][0][1] = "km/h"
    path.write_text(json.dumps(fields))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


@pytest.mark.parametrize("keep", [0, 100, 5000])
def test_a_truncated_file_is_refused(folder, keep):
    path = folder / RECORDING_FILE
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DatasetError, match="truncated or foreign"):
        load_dataset(folder)


def test_a_missing_file_is_named(folder):
    (folder / RECORDING_FILE).unlink()
    with pytest.raises(DatasetError, match=RECORDING_FILE):
        load_dataset(folder)


def test_a_missing_array_is_refused(folder):
    edit_arrays(folder, lambda arrays: arrays.pop("w"))
    with pytest.raises(DatasetError, match=r"expected the arrays x, u, w, pose"):
        load_dataset(folder)


def test_a_data_set_of_another_format_is_refused(folder):
    edit_manifest(folder, lambda fields: fields.update(format_version=1))
    with pytest.raises(DatasetError, match="expected format_version = 2, found 1"):
        load_dataset(folder)


@pytest.mark.parametrize("kind", ["states", "inputs", "exogenous"])
def test_a_manifest_with_a_signal_more_than_there_are_numbers_is_refused(folder, kind):
    edit_manifest(folder, lambda fields: fields["schema"][kind].append(["roll_rad", "rad"]))
    with pytest.raises(DatasetError, match="expected"):
        load_dataset(folder)


def test_a_manifest_without_roads_for_drives_that_know_none_is_refused(folder):
    edit_manifest(folder, lambda fields: fields.update(roads=None))
    with pytest.raises(DatasetError, match="road"):
        load_dataset(folder)


@pytest.mark.parametrize("text", ["{", "[1, 2]", ""])
def test_a_manifest_that_is_no_json_object_is_refused(folder, text):
    (folder / MANIFEST_FILE).write_text(text)
    with pytest.raises(DatasetError, match="expected a"):
        load_dataset(folder)


@pytest.mark.parametrize(
    ("place", "key", "value"),
    [
        (("origin",), "seed", "zero"),
        (("origin",), "episodes", None),
        (("origin", "recipe"), "segment_s", "short"),
        (("origin",), "recipe", [1.0]),
        ((), "sha256", 7),
        ((), "versions", "new"),
        (("schema",), "states", [["vx_mps"]]),
        (("roles",), "centred", "vx_mps"),
        (("roads",), "ey_m", "wide"),
    ],
)
def test_a_manifest_with_a_field_of_another_kind_is_refused(folder, place, key, value):
    def edit(fields):
        for name in place:
            fields = fields[name]
        fields[key] = value

    edit_manifest(folder, edit)
    with pytest.raises(DatasetError, match=key):
        load_dataset(folder)


def test_a_flipped_bit_is_refused_or_makes_no_difference(folder, toy_dataset):
    """No difference: dates and other things that an archive says beside its content."""
    path = folder / RECORDING_FILE
    whole = path.read_bytes()
    # The numbers are long and all alike; what an archive says about itself is at the end.
    dice = random.Random(0)
    places = [dice.randrange(len(whole)) for _ in range(10)]
    places += [len(whole) - 1 - dice.randrange(1000) for _ in range(60)]
    refused = 0
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << dice.randrange(8)
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
