"""Files of a bundle that would block or fill the memory are refused unread."""

import os
import zipfile

import pytest

from rt_controller.contract.errors import ArtifactError
from rt_controller.model.artifact import LARGEST_FILE_BYTES, load_bundle


@pytest.mark.parametrize("name", ["koopman.npz", "encoder.onnx"])
def test_a_pipe_in_a_bundle_is_refused_instead_of_waited_for(folder, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(ArtifactError, match="Not a regular file"):
        load_bundle(folder)


@pytest.mark.parametrize("name", ["koopman.npz", "encoder.onnx"])
def test_a_file_of_gigabytes_is_refused_unread(folder, name):
    os.truncate(folder / name, 2_600_000_000)  # takes no room
    with pytest.raises(ArtifactError, match="2600 MB, where at most 64 MB are read"):
        load_bundle(folder)


def test_an_archive_that_unpacks_to_gigabytes_is_refused_unpacked(folder):
    with (
        zipfile.ZipFile(folder / "koopman.npz", "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open("zeros.npy", "w") as member,
    ):
        for _ in range(30):
            member.write(bytes(10_000_000))
    assert (folder / "koopman.npz").stat().st_size < LARGEST_FILE_BYTES
    with pytest.raises(ArtifactError, match="where at most 256 MB are read"):
        load_bundle(folder)
