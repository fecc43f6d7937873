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
    TRAJECTORIES_FILE,
    cache,
    exists,
    load_dataset,
    save_dataset,
    split_by_episode,
)
from offline.excitation import Recipe
from offline.manifest import Origin, read_manifest
from rt_controller.contract.errors import DatasetError


@pytest.fixture
def folder(toy_folder, tmp_path):
    return shutil.copytree(toy_folder, tmp_path / "data")


def edit_manifest(folder, **changes):
    path = folder / MANIFEST_FILE
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def edit_arrays(folder, edit):
    path = folder / TRAJECTORIES_FILE
    arrays = dict(np.load(path))
    edit(arrays)
    np.savez(path, **arrays)


def test_a_saved_data_set_comes_back_with_its_manifest(toy_dataset):
    assert toy_dataset.trajectories.x.shape == (200, 81, 6)
    assert toy_dataset.manifest.rejected_fraction == pytest.approx(0.2)
    assert toy_dataset.origin.recipe.brakes_n[-1] == 150.0


def test_the_manifest_says_names_units_and_origin_for_others_to_read(toy_folder):
    fields = json.loads((toy_folder / MANIFEST_FILE).read_text())
    assert fields["state_units"] == ["m/s", "m/s", "rad/s", "m", "m", "rad"]
    assert (fields["episodes"], fields["seed"], fields["plant_fingerprint"]) == (40, 3, "toy")
    assert fields["rejected_fraction"] == pytest.approx(0.2)
    assert fields["recipe"]["brakes_n"][-1] == 150.0


def test_a_manifest_that_was_read_is_written_the_same(toy_folder):
    path = toy_folder / MANIFEST_FILE
    assert read_manifest(path).to_json() == path.read_text()


def test_no_episode_is_in_two_parts(toy_dataset):
    parts = [set(toy_dataset.select(part).episode.tolist()) for part in PARTS]
    assert [len(part) for part in parts] == [32, 4, 4]
    assert len(set.union(*parts)) == 40


def test_split_depends_on_the_seed_and_not_on_the_order_of_slices():
    episode = np.repeat(np.arange(50, dtype=np.int32), 5)
    part = split_by_episode(episode, 1)
    shuffled = np.random.default_rng(0).permutation(len(episode))
    assert np.array_equal(split_by_episode(episode[shuffled], 1), part[shuffled])
    assert not np.array_equal(split_by_episode(episode, 2), part)


def test_cache_folder_is_named_after_everything_the_data_follow_from(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert tmp_path in cache().parents
    first = Origin(Recipe(), 100, 0, "car")
    others = [
        replace(first, recipe=Recipe(segment_s=(1.0,))),
        replace(first, episodes=101),
        replace(first, seed=1),
        replace(first, plant_fingerprint="another car"),
    ]
    assert len({first.name, *(other.name for other in others)}) == 5
    assert first.name == Origin(Recipe(), 100, 0, "car").name


def test_cached_data_sets_keep_their_names():
    """Another name would throw away what was made under this one."""
    assert Origin(Recipe(), 7000, 0, "car").name == "7000-episodes-722794dad7e7fb29"


def test_a_folder_without_manifest_is_no_data_set(folder):
    assert exists(folder)
    (folder / MANIFEST_FILE).unlink()
    assert not exists(folder)
    with pytest.raises(DatasetError, match="offline-data"):
        load_dataset(folder)


def test_an_altered_number_is_noticed(folder):
    edit_arrays(folder, lambda arrays: arrays["x"].__setitem__((0, 0, 0), 99.0))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


def test_a_number_that_is_none_is_named_with_its_place(toy_dataset, tmp_path):
    x = toy_dataset.trajectories.x.copy()
    x[7, 5, 4] = np.nan
    save_dataset(
        tmp_path,
        toy_dataset.trajectories._replace(x=x),
        rejected=0,
        origin=toy_dataset.origin,
    )
    with pytest.raises(DatasetError, match="ey_m at step 5 of trajectory 7"):
        load_dataset(tmp_path)


def test_an_altered_split_is_noticed(folder):
    edit_arrays(folder, lambda arrays: arrays["part"].fill(0))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


@pytest.mark.parametrize("keep", [0, 100, 5000])
def test_a_truncated_file_is_refused(folder, keep):
    path = folder / TRAJECTORIES_FILE
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DatasetError, match="truncated or foreign"):
        load_dataset(folder)


def test_a_missing_file_is_named(folder):
    (folder / TRAJECTORIES_FILE).unlink()
    with pytest.raises(DatasetError, match=TRAJECTORIES_FILE):
        load_dataset(folder)


def test_a_missing_array_is_refused(folder):
    edit_arrays(folder, lambda arrays: arrays.pop("kappa"))
    with pytest.raises(DatasetError, match="kappa"):
        load_dataset(folder)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("dt_s", 0.024),
        ("state_fields", ["vy_mps", "vx_mps", "yaw_rate_radps", "ds_m", "ey_m", "epsi_rad"]),
        ("input_units", ["1", "N", "deg"]),
        ("format_version", 99),
    ],
)
def test_data_of_other_signals_or_period_are_refused(folder, key, value):
    edit_manifest(folder, **{key: value})
    with pytest.raises(DatasetError, match=f"expected {key}"):
        load_dataset(folder)


@pytest.mark.parametrize("text", ["{", "[1, 2]", ""])
def test_a_manifest_that_is_no_json_object_is_refused(folder, text):
    (folder / MANIFEST_FILE).write_text(text)
    with pytest.raises(DatasetError, match="expected a"):
        load_dataset(folder)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", "zero"),
        ("episodes", None),
        ("recipe", {"segment_s": "short"}),
        ("recipe", [1.0]),
        ("sha256", 7),
        ("versions", "new"),
    ],
)
def test_a_manifest_with_a_field_of_another_kind_is_refused(folder, key, value):
    edit_manifest(folder, **{key: value})
    with pytest.raises(DatasetError, match=key):
        load_dataset(folder)


def test_a_flipped_bit_is_refused_or_makes_no_difference(folder, toy_dataset):
    """No difference: dates and other things that an archive says beside its content."""
    path = folder / TRAJECTORIES_FILE
    whole = path.read_bytes()
    # The numbers are long and all alike; what an archive says about itself is at the end.
    dice = random.Random(0)
    places = [dice.randrange(len(whole)) for _ in range(10)]
    places += [len(whole) - 1 - dice.randrange(400) for _ in range(60)]
    refused = 0
    for place in places:
        flipped = bytearray(whole)
        flipped[place] ^= 1 << dice.randrange(8)
        path.write_bytes(flipped)
        found = unless_refused(folder)
        refused += found is None
        assert found is None or np.array_equal(found.trajectories.x, toy_dataset.trajectories.x)
    assert refused > 30


def unless_refused(folder):
    try:
        return load_dataset(folder)
    except DatasetError:
        return None
