"""What is on disk is what was made, or it is refused."""

import json
import shutil

import numpy as np
import pytest

from offline.dataset import (
    MANIFEST_FILE,
    PARTS,
    TRAJECTORIES_FILE,
    cache_folder,
    exists,
    load_dataset,
    save_dataset,
    split_by_episode,
)
from offline.excitation import Recipe
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
    assert toy_dataset.manifest["rejected_fraction"] == pytest.approx(0.2)
    assert toy_dataset.manifest["state_units"] == ["m/s", "m/s", "rad/s", "m", "m", "rad"]
    assert toy_dataset.manifest["recipe"]["brakes_n"][-1] == 150.0


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
    first = cache_folder(Recipe(), 100, 0, "car")
    assert tmp_path in first.parents
    others = [
        cache_folder(Recipe(segment_s=(1.0,)), 100, 0, "car"),
        cache_folder(Recipe(), 101, 0, "car"),
        cache_folder(Recipe(), 100, 1, "car"),
        cache_folder(Recipe(), 100, 0, "another car"),
    ]
    assert len({first, *others}) == 5
    assert first == cache_folder(Recipe(), 100, 0, "car")


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
        recipe=Recipe(),
        seed=0,
        plant_fingerprint="toy",
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
