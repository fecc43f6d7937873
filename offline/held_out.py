"""Which data set a model is judged on: the largest whose test part it was not trained on."""

from pathlib import Path

from offline.dataset import MANIFEST_FILE, Dataset, exists, load_dataset
from offline.manifest import read_manifest
from offline.provenance import is_held_out
from offline.run_folder import open_run
from offline.stock import find_dataset, full_folder
from offline.terminal import CONSOLE
from rt_controller.contract.artifact import Bundle
from rt_controller.contract.errors import ArtifactError, DatasetError


def choose_test_set(bundle: Bundle, data: Path | None, run: Path) -> Dataset:
    """The data set in `data`; without it the full one, the model's own, or that of the run.

    The first that exists and was held out.

    Raises:
        DatasetError: there is none, or the one in `data` was not held out.
    """
    if data is not None:
        _require_held_out(bundle, data)
        return load_dataset(data)
    for folder in (full_folder(), find_dataset(bundle.data_sha256), _data_folder(run)):
        if folder is None or not exists(folder):
            continue
        if is_held_out(bundle, read_manifest(folder / MANIFEST_FILE)):
            CONSOLE.print(f"data {folder}", soft_wrap=True)
            return load_dataset(folder)
        CONSOLE.print(
            f"not judged on {folder}: the model may have been trained on its test episodes",
            soft_wrap=True,
        )
    raise DatasetError(
        f"expected a data set that this model was not trained on, or its own "
        f"({bundle.data_sha256:.16}…), found none at hand. Make the full one with offline-data, or "
        f"name one with --data."
    )


def _require_held_out(bundle: Bundle, data: Path) -> None:
    manifest = read_manifest(data / MANIFEST_FILE)
    if not is_held_out(bundle, manifest):
        origin = manifest.origin
        raise DatasetError(
            f"--data {data}: expected the data set that this model was trained on "
            f"({bundle.data_sha256:.16}…), or one of another seed, found {origin.episodes} "
            f"episodes of seed {origin.seed} ({manifest.sha256:.16}…): the model may have been "
            f"trained on some of its test episodes. Leave out --data, or make a data set of "
            f"another seed with offline-data --seed."
        )


def _data_folder(run: Path) -> Path | None:
    try:
        return open_run(run).data_folder
    except ArtifactError:
        return None
