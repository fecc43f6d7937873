"""Damaged, altered or foreign data sets are refused."""

import json
import random
import shutil

import numpy as np
import pytest
from dataset_numbers import same_numbers

from offline.data.dataset import exists, load_dataset
from offline.data.manifest import MANIFEST_FILE, RECORDING_FILE
from rt_controller.contract.errors import DatasetError


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


def test_a_folder_without_manifest_is_refused(folder):
    assert exists(folder)
    (folder / MANIFEST_FILE).unlink()
    assert not exists(folder)
    with pytest.raises(DatasetError, match="offline-data"):
        load_dataset(folder)


@pytest.mark.parametrize("name", ["x", "pose", "slice_ey_m", "slice_row"])
def test_an_altered_number_is_detected(folder, name):
    edit_arrays(folder, lambda arrays: arrays[name].__setitem__(arrays[name].ndim * (0,), 99))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


def test_an_altered_split_is_detected(folder):
    edit_arrays(folder, lambda arrays: arrays["part"].fill(0))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


@pytest.mark.parametrize("altered", ["role", "unit", "roads"])
def test_altered_roles_units_or_roads_are_detected(folder, altered):
    """Roles and units change the training as numbers do."""
    path = folder / MANIFEST_FILE
    fields = json.loads(path.read_text())
    if altered == "role":
        fields["roles"]["odd"] = fields["roles"]["odd"][:-1]
    elif altered == "roads":
        fields["roads"] = None
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


def test_a_missing_recording_is_refused_with_its_name(folder):
    (folder / RECORDING_FILE).unlink()
    with pytest.raises(DatasetError, match=RECORDING_FILE):
        load_dataset(folder)


def test_a_missing_array_is_refused(folder):
    edit_arrays(folder, lambda arrays: arrays.pop("w"))
    with pytest.raises(DatasetError, match=r"expected the arrays x, u, w, pose"):
        load_dataset(folder)


def test_a_data_set_of_another_format_is_refused(folder):
    edit_manifest(folder, lambda fields: fields.update(format_version=1))
    remedy = "Delete the folder and make the data set again with offline-data or offline-import"
    with pytest.raises(DatasetError, match=rf"format_version = 2, found 1\. {remedy}"):
        load_dataset(folder)


@pytest.mark.parametrize("kind", ["states", "inputs", "exogenous"])
def test_a_manifest_with_one_signal_too_many_is_refused(folder, kind):
    edit_manifest(folder, lambda fields: fields["schema"][kind].append(["roll_rad", "rad"]))
    with pytest.raises(DatasetError, match="SHA-256"):
        load_dataset(folder)


@pytest.mark.parametrize("text", ["{", "[1, 2]", ""])
def test_a_manifest_that_is_not_a_json_object_is_refused(folder, text):
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
def test_a_manifest_with_a_field_of_the_wrong_type_is_refused(folder, place, key, value):
    def edit(fields):
        for name in place:
            fields = fields[name]
        fields[key] = value

    edit_manifest(folder, edit)
    with pytest.raises(DatasetError, match=key):
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
