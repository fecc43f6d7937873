"""Which data set models are judged on: the largest whose test part none of them was trained on."""

from collections.abc import Sequence
from pathlib import Path

from offline.dataset import MANIFEST_FILE, Dataset, exists, load_dataset
from offline.lengths import PAST_STEPS
from offline.manifest import Driven, Manifest, read_manifest
from offline.provenance import is_held_out
from offline.roles import past_names
from offline.run_folder import open_run
from offline.stock import find_dataset, full_folder
from offline.terminal import CONSOLE
from rt_controller.contract.artifact import Bundle
from rt_controller.contract.errors import ArtifactError, DatasetError


def choose_test_set(bundles: Sequence[Bundle], data: Path | None, run: Path) -> Dataset:
    """The data set in `data`; without it the full one, one of the models' own, or that of the run.

    The first that exists, has the models' signals and was held out from every one of them.

    Raises:
        DatasetError: there is none, or the one in `data` is none.
    """
    if data is not None:
        _require_judge(bundles, data)
        return load_dataset(data)
    own = [find_dataset(bundle.data_sha256) for bundle in bundles]
    for folder in dict.fromkeys((full_folder(), *own, _data_folder(run))):
        if folder is None or not exists(folder):
            continue
        manifest = read_manifest(folder / MANIFEST_FILE)
        objection = find_objection(bundles, manifest)
        if objection is None:
            CONSOLE.print(f"data {folder}", soft_wrap=True)
            return load_dataset(folder)
        CONSOLE.print(f"not judged on {folder}: {objection}", soft_wrap=True)
    hashes = ", ".join(dict.fromkeys(f"{bundle.data_sha256:.16}…" for bundle in bundles))
    raise DatasetError(
        f"expected a data set that none of the judged models was trained on, or their own "
        f"({hashes}), found none at hand. Make the full one with offline-data, or name one with "
        f"--data."
    )


def find_objection(bundles: Sequence[Bundle], manifest: Manifest) -> str | None:
    """Why models cannot be judged on the test part of that data set; None if they can."""
    for bundle in bundles:
        if not has_signals(bundle, manifest):
            return f"{bundle.name} is a model of other signals, or of another past"
    for bundle in bundles:
        if not is_held_out(bundle, manifest):
            return f"{bundle.name} may have been trained on its test episodes"
    return None


def has_signals(bundle: Bundle, manifest: Manifest) -> bool:
    """Whether the data set shows the model all that it predicts from and nothing else."""
    ours, theirs, lift = bundle.schema, manifest.schema, bundle.lift
    is_same_past = not lift.sees_history or (
        lift.history_fields == past_names(manifest.schema, manifest.roles)
        and lift.history_steps <= PAST_STEPS
    )
    return is_same_past and ours == theirs


def _require_judge(bundles: Sequence[Bundle], data: Path) -> None:
    manifest = read_manifest(data / MANIFEST_FILE)
    objection = find_objection(bundles, manifest)
    if objection is None:
        return
    hashes = ", ".join(dict.fromkeys(f"{bundle.data_sha256:.16}…" for bundle in bundles))
    origin = manifest.origin
    kind = "episodes of seed" if isinstance(origin, Driven) else "imported stretches, split by seed"
    raise DatasetError(
        f"--data {data}: expected the data set that every model was trained on ({hashes}), or one "
        f"that shares nothing with it, found {origin.episodes} {kind} {origin.seed} "
        f"({manifest.sha256:.16}…): {objection}. Leave out --data, or make a data set of another "
        f"seed with offline-data --seed."
    )


def _data_folder(run: Path) -> Path | None:
    try:
        return open_run(run).data_folder
    except ArtifactError:
        return None
