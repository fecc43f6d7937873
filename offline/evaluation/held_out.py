"""Choice of the data set for an evaluation: no model may have been trained on its test part."""

from collections.abc import Callable, Sequence
from pathlib import Path

from offline.config import PAST_STEPS
from offline.data.dataset import Dataset, exists, find_dataset, load_dataset
from offline.data.generate import full_folder
from offline.data.manifest import MANIFEST_FILE, Manifest, Simulated, is_held_out, read_manifest
from offline.data.signals import past_names
from rt_controller.contract.errors import ArtifactError, DatasetError
from rt_controller.contract.signals import Schema
from rt_controller.model.bundle import Bundle


def choose_test_data(
    bundles: Sequence[Bundle], data: Path | None, run: Path, notify: Callable[[str], None]
) -> Dataset:
    """The data set to evaluate these bundles on.

    It is the one in `data`; if that is None, the first that fits of: the full one, those that the
    bundles were trained on, that of the run. `notify` gets a sentence for each data set looked at.

    Raises:
        DatasetError: none fits, or the one in `data` does not.
    """
    hashes = ", ".join(dict.fromkeys(f"{bundle.data_sha256:.16}…" for bundle in bundles))
    if data is not None:
        manifest = read_manifest(data / MANIFEST_FILE)
        objection = find_objection(bundles, manifest)
        if objection is None:
            return load_dataset(data)
        origin = manifest.origin
        is_simulated = isinstance(origin, Simulated)
        kind = "episodes of seed" if is_simulated else "imported stretches, split by seed"
        remedy = (
            "make a data set of another seed with offline-data --seed"
            if all(bundle.schema == manifest.schema for bundle in bundles)
            else f"train a model on it: offline-train --data {data}"
        )
        raise DatasetError(
            f"--data {data}: expected the data set that every model was trained on ({hashes}), or "
            f"one that shares no episode with it, found {origin.episodes} {kind} {origin.seed} "
            f"({manifest.sha256:.16}…): {objection}. Leave out --data, or {remedy}."
        )
    own = [find_dataset(bundle.data_sha256) for bundle in bundles]
    for folder in dict.fromkeys((full_folder(), *own, _data_folder(run))):
        if folder is None or not exists(folder):
            continue
        objection = find_objection(bundles, read_manifest(folder / MANIFEST_FILE))
        if objection is None:
            notify(f"data {folder}")
            return load_dataset(folder)
        notify(f"not evaluated on {folder}: {objection}")
    raise DatasetError(
        f"expected a data set that none of the models was trained on, or their own "
        f"({hashes}), found none. Make the full one with offline-data, or name one with --data."
    )


def find_objection(bundles: Sequence[Bundle], manifest: Manifest) -> str | None:
    """Why the bundles cannot be evaluated on the test part of that data set; None if they can."""
    fields = past_names(manifest.schema, manifest.roles)
    for bundle in bundles:
        lift = bundle.lift
        if bundle.schema != manifest.schema:
            return (
                f"{bundle.name} is a model of other signals: "
                f"{_difference(bundle.schema, manifest.schema)}"
            )
        if lift.history_fields not in ((), fields) or lift.history_steps > PAST_STEPS:
            return (
                f"{bundle.name} reads {lift.history_steps} periods of "
                f"{', '.join(lift.history_fields)}, the data have {PAST_STEPS} of "
                f"{', '.join(fields)}"
            )
    for bundle in bundles:
        if not is_held_out(bundle, manifest):
            return f"{bundle.name} may have been trained on its test episodes"
    return None


def _difference(of_model: Schema, of_data: Schema) -> str:
    """The signals that only one of two schemas has; the period counts as one of them."""
    model, data = _signals(of_model), _signals(of_data)
    only_model = ", ".join(each for each in model if each not in data)
    only_data = ", ".join(each for each in data if each not in model)
    if not only_model and not only_data:
        return "those of the data in another order"
    return f"in the model only: {only_model or 'none'}, in the data only: {only_data or 'none'}"


def _signals(schema: Schema) -> list[str]:
    signals = schema.states + schema.inputs + schema.exogenous
    return [*(f"{name} in {unit}" for name, unit in signals), f"a period of {schema.dt_s:g} s"]


def _data_folder(run: Path) -> Path | None:
    try:
        from offline.training.run import open_run  # torch, which linear baselines do without

        return open_run(run).data_folder
    except ArtifactError:
        return None
